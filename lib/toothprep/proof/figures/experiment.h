// An experiment as data: a folder with `experiment.toml` and the trajectories and parameter files
// that it names. data/figures/ holds those of the paper; copy a folder and change it to make
// another.
//
//   title      shown over its plots
//   kind       what is checked (see Kind)
//   drive      "direct" or "coupled"
//   bur        as --bur
//   trajectory, params    files, beside this one or by path; `params` may be absent
//   specimen   "block" (default) with a table [block]: size_mm, enamel_mm; or "molar"
//   [[run]]    one each for experiments of several: name, title, and any of drive, bur, trajectory,
//              params; `after` names the run whose prepared tooth it starts from, `literal` (kind
//              "literal") the parameters of the literal reading, over `params`
//   [device], [hand], [map]   kind "closed-loop": the simulated device and hand, and the grid of
//              its map of stability
//   measurements   kind "validation": the folder of the tests, in place of all but title and kind
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toothprep/proof/specimen/block.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/tools/device/simulated_phantom.h"

namespace toothprep::figures {

enum class Kind {
  kPlateaus,             // figures 9, 12, 13: level force in each tissue
  kProportionalToSpeed,  // figure 10
  kProportionalToArea,   // figure 11
  kStall,                // figure 14
  kClosedLoop,           // figure 15
  kPreparations,         // figure 16
  kLiteral,              // both readings of the paper
  kDroop,                // both collapses of a drooping handpiece
  kPasses,               // work and force of overlapping straight passes
  kValidation            // published cutting tests
};

struct Run {
  std::string name;   // letters, digits and hyphens: a file name
  std::string title;  // in words
  Drive drive = Drive::kCoupled;
  std::string bur;
  std::string trajectory;  // path
  std::string params;      // path; empty: none
  std::string literal;     // path
  std::string after;       // name of an earlier run
};

struct StabilityGrid {
  std::vector<double> dampings;     // N·s/mm
  std::vector<double> masses;       // N·s²/mm
  std::vector<double> stiffnesses;  // N/mm
};

struct Experiment {
  std::string name;  // of the folder
  std::string title;
  Kind kind = Kind::kPlateaus;
  bool molar = false;
  BlockOptions block;     // without voxel size
  std::vector<Run> runs;  // at least one
  PhantomModel device;
  HandModel hand;
  StabilityGrid map;
  std::string measurements;  // folder of the cutting tests (cutting_test.h); kind "validation"
};

// Reads FOLDER/experiment.toml. Throws InputError with the key for whatever isn't as above.
Experiment read_experiment(const std::string& folder);

// The folders in `folder` that hold an experiment.toml, in order of their names. `only` chooses by
// name, or by the number in it ("9" is figure-09); empty: all. Throws Error naming a choice that
// nothing matches, and what there is.
std::vector<std::string> find_experiments(const std::string& folder,
                                          const std::vector<std::string>& only);

// Parameters of a run: `base`, then its params file, then (with `literal`) its literal file over
// them.
Parameters parameters_of(const Run& run, const Parameters& base, bool literal = false);

}  // namespace toothprep::figures
