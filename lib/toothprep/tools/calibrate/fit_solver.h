// The least-squares problem of a fit and its minimum.
//
// Ceres descends; a chunk's residuals r (3n of them) go to it as kColumns + 1 numbers that have the
// same sum of squares, gradient and J^T J: a square root of [J r]^T [J r]. Thousands of samples then
// cost the solver nothing, and a recording of ten minutes needs no Jacobian of a gigabyte. The
// robust loss is in r already (Weighting::kTransformed).
//
// With delay, rotation and low-pass held, u and w enter linearly: J at u = w = 1 is the basis
// itself. Starts and what the recordings determine are found so.
#pragma once

#include "toothprep/tools/calibrate/fit_data.h"

namespace toothprep {

struct Linear {
  Eigen::VectorXd x;  // u, w, bias, ...: in the order of the free set
  Eigen::MatrixXd H;
  double cost = 0;
};
Linear solve_linear(const FitData& data, const FreeSet& free, ModelState state, std::size_t stride,
                    int passes);
bool all_positive(const Linear& linear, const FreeSet& free);
// `state` at the linear solution; what isn't positive there starts from the options.
ModelState moved_to(const Linear& linear, const FreeSet& free, const FitOptions& options,
                    ModelState state);

// Descends from `state`, which it moves; the cost in the end. Throws Error if that fails.
double minimise(const FitData& data, const FreeSet& free, const FitOptions& options,
                std::size_t stride, ModelState& state);

struct Solution {
  FitData data;  // with sigma as the residuals have it, behind the low-pass that was found
  ModelState state;
  double start_spread = 0;  // largest relative difference of u, u/alpha between the starts
};
// From several starts to the exact minimum, with the noise as it turns out to be.
Solution solve(FitData data, const ModelState& start, const Asked& asked,
               const FitOptions& options);

// Standard deviation of normal values by their median size.
double robust_scale(std::vector<double> values);

}  // namespace toothprep
