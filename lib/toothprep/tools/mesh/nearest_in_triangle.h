// The nearest point of one triangle, in double precision.
#pragma once

#include <algorithm>
#include <array>
#include <limits>

#include "toothprep/step/core/geometry.h"

namespace toothprep {

using Corners = std::array<Vec3, 3>;  // of a triangle, mm

// Weights of the nearest point of a segment; `from` and `to` say which corners it joins.
inline void try_segment(const Corners& c, int from, int to, const Vec3& x, double& best,
                        Vec3& weights) {
  const Vec3 along = c[to] - c[from];
  const double length2 = along.squaredNorm();
  const double t = length2 > 0 ? std::clamp((x - c[from]).dot(along) / length2, 0.0, 1.0) : 0.0;
  const double distance2 = (c[from] + t * along - x).squaredNorm();
  if (distance2 >= best) return;
  best = distance2;
  weights = Vec3::Zero();
  weights[from] = 1 - t;
  weights[to] += t;
}

// Weights of the triangle's nearest point; a weight is exactly zero unless the point lies in the
// interior that it stands for. The plane's foot if it is inside, else the nearest of the edges.
[[nodiscard]] inline Vec3 nearest_weights(const Corners& c, const Vec3& x) {
  const Vec3 ab = c[1] - c[0], ac = c[2] - c[0], n = ab.cross(ac);
  const double area2 = n.squaredNorm();
  if (area2 > 1e-24 * ab.squaredNorm() * ac.squaredNorm()) {
    const Vec3 ax = x - c[0];
    const double w1 = ax.cross(ac).dot(n) / area2, w2 = ab.cross(ax).dot(n) / area2;
    if (w1 > 0 && w2 > 0 && w1 + w2 < 1) return Vec3(1 - w1 - w2, w1, w2);
  }
  double best = std::numeric_limits<double>::infinity();
  Vec3 weights = Vec3::UnitX();
  for (int k = 0; k < 3; ++k) try_segment(c, k, (k + 1) % 3, x, best, weights);
  return weights;
}

// mm
[[nodiscard]] inline double distance_to_triangle(const Corners& c, const Vec3& x) {
  const Vec3 w = nearest_weights(c, x);
  return (w[0] * c[0] + w[1] * c[1] + w[2] * c[2] - x).norm();
}

}  // namespace toothprep
