// What the recordings determine: per tissue, whether u and alpha, u/alpha only, or nothing is
// fitted.
#pragma once

#include "toothprep/tools/calibrate/fit_start.h"

namespace toothprep {

struct FitModes {
  ModelState state;  // with the modes; tissues left aside stand at their start values
  PerTissue<WhyNot> why_not;
  std::vector<double> singular_values;  // of the weighted basis, columns scaled to length 1
};

// From the weighted basis: relative standard deviations that a sensor of realistic noise would
// leave, one tissue parameter after another, the worst first. Throws Error if nothing can be fitted.
FitModes choose_modes(const FitStart& start, const FitOptions& options);

}  // namespace toothprep
