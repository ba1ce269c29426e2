// Runs the items of a manifest as child processes, so many at a time; what is done stays done.
//
// An item works in a hidden part of DIR, which becomes DIR/NAME when it has ended: an item's folder
// is whole or not there. It holds what the command wrote, log.txt (the command's stderr) and
// item.json (the command line, SHA-256 of inputs and outputs, the program's version, status). An
// item is done, and not run again, if its item.json says so for the same command line, inputs and
// version, and its outputs still have their hashes. DIR/batch.csv and DIR/batch.json have a row for
// each item, the same bytes however many ran at a time and whether they ran now or before.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "toothprep/tools/batch/item_figures.h"
#include "toothprep/tools/batch/manifest.h"

namespace toothprep {

struct BatchOptions {
  std::string folder;   // DIR; made if it isn't there
  std::string program;  // the program's path; runs as: program COMMAND ARGUMENTS
  std::vector<std::string> program_arguments;        // after the command: --quiet and the like
  std::string version, build;                        // of the program
  int at_once = 1;                                   // children at a time
  bool redo = false;                                 // also what is done
  double time_limit = 0;                             // of an item, s; 0: none
  std::function<bool()> interrupted;                 // asked often; true ends the batch
  std::function<void(const std::string&)> progress;  // a line for each item that ended
};

struct BatchResult {
  std::vector<ItemRow> rows;  // in the manifest's order
  std::size_t run = 0;        // items that ran now; the others were done before
  bool interrupted = false;   // then rows hold only what ended, and no table was written
};

// Throws Error if the folder can't be used: not writable, in use by another batch, or with a folder
// of an item's name, or a file in one, that no batch wrote. What goes wrong with an item is reported in its row.
BatchResult run_batch(const BatchManifest& manifest, const BatchOptions& options);

}  // namespace toothprep
