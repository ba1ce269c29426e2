#include "toothprep/step/grinding/edge_ridges.h"

#include <algorithm>
#include <cmath>

namespace toothprep {
namespace {

constexpr int kPlaces = 16;  // along an edge, from one side of the motion to the other

}  // namespace

EdgeRidges::EdgeRidges(const Bur& bur) {
  for (const SharpEdge& e : sharp_edges(bur.profile()))
    edges_.push_back({e.before.along_z, -e.before.along_r, e.after.along_z, -e.after.along_r});
}

double EdgeRidges::height_per_step(const Vec3& along) const noexcept {
  const double across = std::hypot(along.x(), along.y());
  double highest = 0;
  for (const Edge& e : edges_)
    for (int i = 0; i <= kPlaces; ++i) {
      const double outwards = across * (2.0 * i / kPlaces - 1);
      // Sines of the angles between the motion and the faces.
      const double before = e.before_r * outwards + e.before_z * along.z(),
                   after = e.after_r * outwards + e.after_z * along.z();
      if (before * after >= 0) continue;
      const double a = std::min(std::abs(before), 1.0), b = std::min(std::abs(after), 1.0);
      const double sum = a * std::sqrt(1 - b * b) + b * std::sqrt(1 - a * a);
      if (sum > 0) highest = std::max(highest, a * b / sum);
    }
  return highest;
}

}  // namespace toothprep
