// One replay of an experiment, and what it is compared with.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "toothprep/proof/figures/experiment.h"
#include "toothprep/proof/reference/coupled_feed.h"
#include "toothprep/step/session/replay.h"

namespace toothprep::figures {

// The exact answer beside a replay, one entry per row as far as it goes (a bur that starts again
// after a stall is beyond it).
struct Exact {
  std::vector<Vec3> force;              // N, on the bur, W
  std::vector<double> torque;           // N·mm
  std::vector<PerTissue<double>> area;  // mm², advancing contact
  std::optional<reference::StallEvent> stall;
};

struct Outcome {
  ReplayResult replay;
  Parameters parameters;
  std::string tooth_sha256;
  LayeredTooth prepared;
};

// The specimen of a run at a voxel size, mm.
LayeredTooth make_specimen(const Experiment& experiment, const Run& run, double voxel);

// The samples that a run commands, at the parameters' time step.
std::vector<HandleSample> path_of(const Run& run, const Parameters& parameters);

// Replays `run` along its path on `tooth`, which becomes the outcome's prepared tooth.
Outcome run_on(const Run& run, const Parameters& parameters, const std::vector<HandleSample>& path,
               LayeredTooth tooth, const std::string& bur_library);

// The integrals of reference/ along what was replayed: in direct drive the load at each row's pose
// and velocity, in coupled drive the equation of the spring and the tissue, solved by itself.
// Only for blocks, and for paths along which all advancing surface meets fresh tissue.
Exact exact_answer(const Run& run, const Parameters& parameters,
                   const std::vector<HandleSample>& path, const std::string& bur_library);

struct ExactTask {
  const Run& run;
  const Parameters& parameters;
  const std::vector<HandleSample>& path;
};
// The exact answer of each, in parallel; found once for those that differ only in what it doesn't
// depend on: the engine and the size of its elements.
std::vector<Exact> exact_answers(const std::vector<ExactTask>& tasks,
                                 const std::string& bur_library);

// Rows [first, last] over which the bur is fully in one tissue, with all of the contact that it
// ever has; a plateau is where the force is level too.
struct Stretch {
  Tissue tissue = Tissue::kEnamel;
  std::size_t first = 0, last = 0;
};
std::vector<Stretch> fully_engaged(const Exact& exact);
std::vector<Stretch> plateaus(const Exact& exact);

// How far a replay is from the exact answer, in percent of the largest exact force (torque) on a
// plateau, or of the largest at all where there is none.
struct Deviation {
  double force_rms = 0, force_max = 0;    // of |F - F_exact| over the rows in contact
  double torque_rms = 0, torque_max = 0;  // of |T - T_exact|
};
Deviation deviation(const Outcome& outcome, const Exact& exact);

// The voxel effect: RMS of F - F_exact over a plateau's rows, in percent of the plateau's force:
// the whole band, and its part above 2 Hz.
struct VoxelEffect {
  double whole = 0, above_2_hz = 0;
};
VoxelEffect voxel_effect(const Outcome& outcome, const Exact& exact, const Stretch& stretch);

// Mean over a stretch.
struct Level {
  Vec3 force = Vec3::Zero();  // N
  double torque = 0;          // N·mm
};
Level level(const Outcome& outcome, const Stretch& stretch);
Level level(const Exact& exact, const Stretch& stretch);

}  // namespace toothprep::figures
