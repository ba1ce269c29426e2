// Runs the items of a manifest as child processes, so many at a time; what is done stays done.
//
// An item works in a hidden part of DIR, which becomes its folder when it has ended: an item's
// folder is whole or not there. It holds what the command wrote, log.txt (the command's stderr) and
// item.json (the command line, SHA-256 of inputs and outputs, the program's version, status). An
// item is done, and not run again, if its item.json says so for the same command line, inputs and
// version, and its outputs still have their hashes. It runs when all that it needs is done.
// DIR/batch.csv, batch.json and batch.h5 have a row for each item, the same bytes however many ran at a
// time, where, and whether they ran now or before.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/batch/item_figures.h"
#include "toothprep/tools/batch/manifest.h"

namespace toothprep {

class ChildStarter;
class Claims;

// Which items may run; the others count as they are.
struct BatchSelection {
  std::string only;     // those whose name matches the pattern, and what they need; empty: all
  bool failed = false;  // those that failed before
  std::optional<std::vector<std::string>> names = {};  // these alone, whatever else there is
};

struct BatchOptions {
  std::string folder;   // DIR; made if it isn't there
  std::string program;  // the program's path; runs as: program COMMAND ARGUMENTS
  // In place of starting `program`: forks children that do its work with the arguments. Saves the
  // time that a program of many libraries takes to start. Made before the manifest is read.
  ChildStarter* starter = nullptr;
  std::vector<std::string> program_arguments = {};  // after the command: --quiet and the like
  std::string version, build;                       // of the program
  int at_once = 1;                                  // children at a time
  bool redo = false;                                // also what is done
  bool look = false;                                // runs and writes nothing: what is done
  bool tables_of_all = false;  // of all items, whatever the selection's names leave out
  double time_limit = 0;       // of an item, s; 0: none
  BatchSelection selection = {};
  // One of several processes that share the folder: its name, and what keeps them off each other's
  // items. It writes no tables.
  std::string worker = {};
  Claims* claims = nullptr;
  std::function<bool()> interrupted = {};                 // asked often; true ends the batch
  std::function<void(const std::string&)> progress = {};  // a line for each item that ended
  // What a user would want to know early: items like those that ended will fill the disk.
  std::function<void(const std::string&)> warn = {};
  std::function<double()> free_disk = {};  // bytes; absent: asked of the folder's file system
};

struct BatchResult {
  ItemRows rows;           // of the items that ended, in the manifest's order
  std::size_t run = 0;     // items that ran now; the others were done before
  std::size_t failed = 0;  // of the rows
  // Items that neither were done nor ran: indices into the manifest's.
  std::vector<std::size_t> left;
  // Of a worker: those of them that something killed, as a lack of memory does.
  std::vector<std::size_t> killed;
  bool interrupted = false;             // then no table was written
  std::vector<double> seconds, memory;  // per item, where known; else 0
};

// Throws Error if the folder can't be used: not writable, in use by another batch, or with a folder
// of an item's name, or a file in one, that no batch wrote. What goes wrong with an item is reported
// in its row.
BatchResult run_batch(BatchManifest manifest, const BatchOptions& options);

}  // namespace toothprep
