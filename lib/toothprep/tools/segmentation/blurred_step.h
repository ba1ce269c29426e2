// A step blurred by a Gaussian of standard deviation one: its height at z.
#pragma once

#include <cmath>

namespace toothprep {

inline double blurred_step(double z) { return 0.5 * std::erfc(-z * M_SQRT1_2); }

// Where it is `q` high, 0 < q < 1; within 6 of the step.
inline double place_on_step(double q) {
  double low = -6, high = 6;
  for (int i = 0; i < 40; ++i) {
    const double middle = 0.5 * (low + high);
    (blurred_step(middle) < q ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

// Its slope half-way, where it is steepest, for that standard deviation.
inline double steepest(double sigma) { return 1 / (sigma * std::sqrt(2 * M_PI)); }

}  // namespace toothprep
