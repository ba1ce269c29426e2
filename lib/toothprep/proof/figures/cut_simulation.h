// A cutting test, simulated: a cylinder through a block under an imposed load or feed.
#pragma once

#include <map>
#include <mutex>
#include <string>

#include "toothprep/proof/figures/cutting_test.h"
#include "toothprep/step/core/parameters.h"

namespace toothprep::figures {

// Means over the cut's first third of a millimetre (of a face: down to its depth).
struct CutResult {
  bool stalled = false;      // at its end; the rest is then 0
  double feed = 0;           // mm/s
  double removal_rate = 0;   // mm³/s
  double force_along = 0;    // N, against the feed
  double tangential = 0;     // N, torque over radius
  double normal = 0;         // N, the rest of the force
  double torque = 0;         // N·mm
  double rotation_rate = 0;  // rev/s
  double free_rate = 0;      // rev/s, without load
  double energy_ratio = 0;   // of the session's audit
};

// `parameters` with the cut's handpiece: an electric one in place of one that droops.
Parameters parameters_for(const Cut& cut, const Parameters& parameters);

CutResult simulate_cut(const Cut& cut, const Parameters& parameters);

// simulate_cut() of what several tests ask for is done once.
class KnownCuts {
 public:
  CutResult simulate(const Cut& cut, const Parameters& parameters);

 private:
  std::mutex mutex_;
  std::map<std::string, CutResult> results_;  // by all that they depend on
};

// All values that the test's quantity takes over its cuts, as far as there is one: a stalled cut
// has no feed; a handpiece that doesn't droop loses no speed and has no greatest power.
struct Prediction {
  std::vector<double> values;
  bool stalled = false;  // in any cut
};
Prediction predict(const CuttingTest& test, const std::vector<Cut>& cuts,
                   const Parameters& parameters, KnownCuts& known);

}  // namespace toothprep::figures
