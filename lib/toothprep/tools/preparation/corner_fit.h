// Two straight sides in a plane and the rounding between them, fitted to points of a surface.
#pragma once

#include <vector>

#include "toothprep/tools/preparation/section.h"

namespace toothprep {

// Side 1 is known: the line through (0, 0), off the y axis by `wall_angle` towards -x going up. Side
// 2 ends at x = `end` near y = 0 and falls by `slope` on its way there. Both bound what lies above and
// outside of them.
struct CornerFit {
  double slope = 0;   // radians
  double radius = 0;  // mm, of an arc that touches both sides
  double arc = 0;     // share of side 2 that the arc takes: 1 when nothing straight is left of it
  double angle = 0;   // radians, between both sides on the side that they bound
  double misfit = 0;  // mm, RMS distance of the points
};

// The fit with the least squares, its end's height free. At least eight points, else misfit is
// infinite. The radius is limited to what leaves the arc on side 2.
CornerFit fit_corner(const std::vector<Vec2>& points, double wall_angle, double end);

}  // namespace toothprep
