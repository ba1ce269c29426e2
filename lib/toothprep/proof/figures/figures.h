// The experiments of Wu, Wang, Wang and Zhang's section 6 (figures 9 to 16), and a few of ours, run
// and checked against closed forms and exact integrals.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "toothprep/proof/figures/report.h"
#include "toothprep/step/core/parameters.h"

namespace toothprep::figures {

struct FigureOptions {
  std::vector<std::string> experiments;  // folders (find_experiments)
  std::vector<EngineKind> engines = {EngineKind::kLevelset, EngineKind::kVoxel};
  double voxel = 0.1;  // mm; feed experiments are also run at twice and at half of it
  Parameters base;     // under each experiment's own
  std::string bur_library;
  std::string version, build;  // of the program
  std::string output;          // an existing folder; one folder per experiment is made in it
  // Called with the replays done, their number, and what was done last; one call at a time, from
  // any thread.
  std::function<void(int, int, const std::string&)> progress;
};

// Runs the experiments and their replays in parallel; the results don't depend on the number of
// threads. Writes traces (.h5), exact answers (.csv), meshes (.ply), figures.json and
// figures.md. Throws Error as reading the experiments and replaying do.
std::vector<FigureReport> run_figures(const FigureOptions& options);

}  // namespace toothprep::figures
