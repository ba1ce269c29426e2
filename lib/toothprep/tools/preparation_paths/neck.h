// Where the enamel ends on a tooth's side.
#pragma once

#include <Eigen/Core>

#include "toothprep/tools/placement/tooth_grid.h"

namespace toothprep {

// Distance from the axis through `middle` (x, y) to the outermost tooth in direction `out` (unit) at
// the height z, mm; negative where there is none.
[[nodiscard]] double outline_radius(const ToothGrid& grid, const Eigen::Vector2d& middle,
                                    const Eigen::Vector2d& out, double z);

// Height of the enamel's lower border on the side in direction `out`, searched downwards from `top`;
// where the tooth ends before the enamel does, its end. mm, z of the grid's frame.
[[nodiscard]] double neck_height(const ToothGrid& grid, const Eigen::Vector2d& middle,
                                 const Eigen::Vector2d& out, double top);

}  // namespace toothprep
