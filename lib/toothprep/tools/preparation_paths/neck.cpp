#include "toothprep/tools/preparation_paths/neck.h"

#include <cmath>

namespace toothprep {

using Vec2 = Eigen::Vector2d;

double outline_radius(const ToothGrid& grid, const Vec2& middle, const Vec2& out, double z) {
  const double step = grid.step();
  for (double r = 12; r > 0; r -= 0.5 * step)
    if (const Vec3 x(middle.x() + r * out.x(), middle.y() + r * out.y(), z);
        ToothGrid::is_tooth(grid.at(x)))
      return r + 0.25 * step;
  return -1;
}

double neck_height(const ToothGrid& grid, const Vec2& middle, const Vec2& out, double top) {
  constexpr double kUnderSurface = 0.3, kGap = 0.6;  // mm
  double last = top;                                 // with enamel
  for (double z = top; z > grid.low().z() && z > last - kGap; z -= grid.step()) {
    const double r = outline_radius(grid, middle, out, z);
    if (r < 0) break;
    bool enamel = false;
    for (double d = 0; d <= kUnderSurface && !enamel; d += 0.5 * grid.step()) {
      const Vec2 p = middle + (r - d) * out;
      enamel = grid.at(Vec3(p.x(), p.y(), z)) == Tissue::kEnamel;
    }
    if (enamel) last = z;
  }
  return last - 0.5 * grid.step();
}

}  // namespace toothprep
