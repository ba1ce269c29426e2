// Whether one surface lies within a distance of another: of every point of it, not of samples.
//
// The distance from a triangle, being convex, is over a convex piece of the one surface greatest at
// a corner of it. So each triangle is divided where the nearest triangle of the other surface ends
// (by planes through its edges), until each piece's corners are within the limit of one triangle, or
// until the piece is so small that its middle's distance and its size together are.
#pragma once

#include <cstdint>
#include <vector>

#include "toothprep/tools/mesh/surface.h"
#include "toothprep/tools/mesh/triangle_tree.h"

namespace toothprep {

struct SurfaceDistance {
  double greatest_mm = 0;  // of the points that were looked at
  // Triangles that have a point beyond the limit, or less than a fiftieth of the limit within it,
  // so that they could not be shown to be within; ascending.
  std::vector<std::uint32_t> beyond;
};

// Of `from`'s triangles to the surface `to`, whose tree is given too. By all threads; the same bits
// for any number of them.
[[nodiscard]] SurfaceDistance surface_distance(const TriangleMesh& from, const TriangleMesh& to,
                                               const TriangleTree& tree, double limit_mm);

}  // namespace toothprep
