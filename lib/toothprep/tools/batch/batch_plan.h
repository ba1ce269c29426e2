// What a batch will take: time, memory and disk, from a trial of one item of each kind.
#pragma once

#include <string>
#include <vector>

#include "toothprep/tools/batch/manifest.h"
#include "toothprep/tools/batch/run_batch.h"

namespace toothprep {

// Of the items of one step of a sweep, or else of one command.
struct BatchKind {
  std::string name, command;
  std::size_t items = 0;
  std::size_t first = 0;                // the item that was tried
  double seconds = 0, memory = 0;       // of that one; s, bytes
  double bytes = 0, bytes_written = 0;  // that it keeps, and before what isn't kept is removed
  std::string failure;                  // why the trial failed
};

// Runs the first item of each kind, with what it needs, in a temporary folder.
std::vector<BatchKind> trial_of(const BatchManifest& manifest, const BatchOptions& options);

// `free_disk`: bytes where the results will be; a line says so if they won't do.
std::string plan_text(const BatchManifest& manifest, const std::vector<BatchKind>& kinds,
                      int at_once, double free_disk);

}  // namespace toothprep
