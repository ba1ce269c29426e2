// A whole path through a session: the rows of a trace and the figures of the run.
#pragma once

#include <functional>
#include <vector>

#include "toothprep/step/session/session.h"

namespace toothprep {

struct ReplayResult {            // what `toothprep replay` writes and prints
  std::vector<StepRecord> rows;  // one per sample; row 0 is the initial state
  SessionTotals totals;          // of the session, at its end
  double removed_energy = 0;     // N·mm = mJ: sum of u_k V_k
  double energy_ratio = 0;       // torque work / removed energy; NaN if nothing was removed
  double seconds_simulated = 0;  // from the first row to the last
  double seconds_computed = 0;   // wall time of the steps
  double step_us_p50 = 0, step_us_p99 = 0, step_us_max = 0;  // of single steps
};

// Runs `path` (samples at parameters.time_step) and carves `workpiece`. `progress`, if given, is
// called now and then with the fraction done. Throws Error for a path of fewer than two samples,
// and as Session's constructor does.
ReplayResult replay(const Bur& bur, Workpiece& workpiece, const Parameters& parameters, Drive drive,
                    const std::vector<HandleSample>& path,
                    const std::function<void(double)>& progress = {});

// Smallest distance from a path's tip positions to the box around the solid, mm.
[[nodiscard]] double distance_to_tooth(const std::vector<HandleSample>& path, const Box& box);

}  // namespace toothprep
