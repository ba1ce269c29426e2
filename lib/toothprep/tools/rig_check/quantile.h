// Order statistics, as rig_figures.h defines them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace toothprep {

// The smallest value that at least `share` of the values do not exceed. `values` not empty; it is
// reordered.
inline double quantile(std::vector<double>& values, double share) {
  const auto n = static_cast<double>(values.size());
  const double rank = std::clamp(std::ceil(share * n), 1.0, n) - 1;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

}  // namespace toothprep
