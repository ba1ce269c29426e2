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
//              params, block; `after` names the run whose prepared tooth it starts from, `literal` (kind
//              "literal") the parameters of the literal reading, over `params`
//   [device], [hand], [map]   kind "closed-loop": the simulated device and hand, and the grid of
//              its map of stability; the first two also of kind "ablations", whose runs have
//              `engine`, `layers`, `integrator` and `filter_hz` besides
//   [device], [hand], [map], [stated], [thresholds]   kind "feasibility": see Feasibility
//   [[device]], [hand], [grid], [thresholds]   kind "transparency": see Transparency
//   measurements   kind "validation": the folder of the tests, in place of all but title and kind
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toothprep/proof/figures/ablation.h"
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
  kAblations,            // the paper's arguments: its method with parts taken out
  kFeasibility,          // figure 13 as the paper set it up, and what it states at once
  kLaws,                 // grinding laws beyond the paper's
  kRotor,                // a rotor with inertia
  kValidation,           // published cutting tests
  kTransparency          // the coupling on several devices: what it hides, what it lets ring
};

struct Run {
  std::string name;   // letters, digits and hyphens: a file name
  std::string title;  // in words
  Drive drive = Drive::kCoupled;
  std::string bur;
  std::string trajectory;                  // path
  std::string params;                      // path; empty: none
  std::string literal;                     // path
  std::string after;                       // name of an earlier run
  BlockOptions block;                      // without voxel size
  Ablation ablation;                       // kind "ablations"
  EngineKind engine = EngineKind::kVoxel;  // of the same kind; elsewhere the command line's
};

struct StabilityGrid {
  std::vector<double> dampings;     // N·s/mm
  std::vector<double> masses;       // N·s²/mm
  std::vector<double> stiffnesses;  // N/mm
};

// What the paper states about one bur in one tissue, thresholds of our own for its words ("near",
// "small"), and the grid of what it leaves open.
struct Feasibility {
  double stall_torque = 1.2;           // N·mm
  double stall_speed = 0.7;            // mm/s, in enamel, at that torque
  double resistance = 4;               // N·s/mm, of "a tooth"
  double direct_limit = 0.01;          // N·s/mm, what direct rendering renders stably
  double stall_speed_percent = 7;      // ours: this near
  double resistance_percent = 10;      // ours: this near
  double peak_percent = 90;            // ours: of the plateau, at least, for a small difference
  std::vector<double> rotation_rates;  // N, rev/s
  std::vector<double> stiffnesses;     // k, N/mm
  std::vector<double> engaged;         // length of the bur in tissue, mm
};

// A device to render on. What is not in its model: the stiffness that public practice renders
// stably on it, and the coupling's damper that is recommended for it.
struct RenderingDevice {
  std::string name, title;
  PhantomModel model;              // its rate is that of the time step
  double practical_stiffness = 1;  // N/mm
  double recommended_damping = 0;  // N·s/mm
};

struct Transparency {
  std::vector<RenderingDevice> devices;
  std::vector<double> stiffnesses;  // k, N/mm
  std::vector<double> dampings;     // b, N·s/mm, beside 0
  std::vector<double> feeds;        // mm/s; the first is that of the closed loops
  std::vector<double> frequencies;  // whole Hz, of the transfer
  std::vector<double> time_steps;   // s, of ringing; their limit 0 comes besides
  double settled_time = 0.02;       // s
  double settled_share = 0.05;      // of the release
  double felt = 0.05;               // N, RMS above 20 Hz
};

struct Experiment {
  std::string name;  // of the folder
  std::string title;
  Kind kind = Kind::kPlateaus;
  bool molar = false;
  std::vector<Run> runs;  // at least one
  PhantomModel device;
  HandModel hand;
  StabilityGrid map;
  Feasibility feasibility;    // kind "feasibility"
  Transparency transparency;  // kind "transparency"
  std::string measurements;   // folder of the cutting tests (cutting_test.h); kind "validation"
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
