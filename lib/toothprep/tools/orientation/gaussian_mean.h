// Maps of heights, smoothed.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace toothprep {

// The mean over a Gaussian of `sigma` mm at every column that has a height; `none` stands for no
// height. Columns are `step` mm apart, column (x, y) at y * nx + x.
[[nodiscard]] inline std::vector<double> gaussian_mean(const std::vector<double>& heights, int nx,
                                                       int ny, double step, double sigma,
                                                       double none) {
  const auto at = [nx](int x, int y) { return static_cast<std::size_t>(y) * nx + x; };
  const int reach = std::max(1, static_cast<int>(std::ceil(2.5 * sigma / step)));
  std::vector<double> result = heights;
  for (int y = 0; y < ny; ++y)
    for (int x = 0; x < nx; ++x) {
      if (heights[at(x, y)] == none) continue;
      double sum = 0, weights = 0;
      for (int j = std::max(0, y - reach); j <= std::min(ny - 1, y + reach); ++j)
        for (int i = std::max(0, x - reach); i <= std::min(nx - 1, x + reach); ++i) {
          const double h = heights[at(i, j)];
          if (h == none) continue;
          const double off2 = ((i - x) * (i - x) + (j - y) * (j - y)) * step * step;
          const double w = std::exp(-off2 / (2 * sigma * sigma));
          sum += w * h;
          weights += w;
        }
      result[at(x, y)] = sum / weights;
    }
  return result;
}

}  // namespace toothprep
