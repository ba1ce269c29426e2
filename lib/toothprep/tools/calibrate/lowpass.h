// A first-order low-pass, tau dy/dt = x - y, as a sensor's amplifier has it.
#pragma once

#include <cmath>

namespace toothprep {

// One step of it, exact for an x that is linear between samples (so also right for tau << step,
// where a trapezoid would ring): y_i = keep y_{i-1} + before x_{i-1} + now x_i.
struct LowpassStep {
  double keep = 0, before = 0, now = 1;
};

// `time_constant` and `step` in s; a time constant of 0 lets everything through.
inline LowpassStep lowpass_step(double time_constant, double step) {
  if (!(time_constant > 0)) return {};
  const double a = step / time_constant, keep = std::exp(-a);
  const double lag = -std::expm1(-a) / a;  // mean of what is kept over the step
  return {keep, lag - keep, 1 - lag};
}

}  // namespace toothprep
