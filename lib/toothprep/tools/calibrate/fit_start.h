// What a fit starts from: the recordings checked and weighed, and a first guess of what a descent
// doesn't find by itself (delay, rotation, low-pass).
#pragma once

#include <string>
#include <vector>

#include "toothprep/tools/calibrate/fit_data.h"

namespace toothprep {

struct FitStart {
  FitData data;
  ModelState state;
  Asked asked{};                    // what can be estimated of what was asked for
  std::string weight_why_not;       // where the weight was asked for and can't be
  PerTissue<double> touched{};      // s
  PerTissue<double> removed{};      // mm³
  std::vector<double> quiet_noise;  // N per recording, without contact; NaN if there is too little
};

// Throws Error for options that contradict each other and for recordings that can't be fitted.
FitStart start_of(std::vector<ComparedRecording> recordings, const FitOptions& options);

}  // namespace toothprep
