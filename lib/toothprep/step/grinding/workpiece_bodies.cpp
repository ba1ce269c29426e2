#include "toothprep/step/grinding/workpiece_bodies.h"

#include <algorithm>

namespace toothprep {
namespace {

constexpr std::uint8_t kFar = 255;

// Distances (the largest along an axis) to the bricks with 0: a sweep there and one back over half
// of the 26 neighbours each, which is exact for this metric.
void spread_distances(const Index3& n, std::vector<std::uint8_t>& away) {
  const auto at = [&](int x, int y, int z) {
    return (static_cast<std::size_t>(x) * n.y() + y) * n.z() + z;
  };
  const auto visit = [&](int x, int y, int z, int direction) {
    std::uint8_t& here = away[at(x, y, z)];
    for (int dx = -1; dx <= 0; ++dx)
      for (int dy = -1; dy <= (dx < 0 ? 1 : 0); ++dy)
        for (int dz = -1; dz <= (dx < 0 || dy < 0 ? 1 : -1); ++dz) {
          const int u = x + direction * dx, v = y + direction * dy, w = z + direction * dz;
          if (u < 0 || v < 0 || w < 0 || u >= n.x() || v >= n.y() || w >= n.z()) continue;
          const std::uint8_t beside = away[at(u, v, w)];
          if (beside < kFar && beside + 1 < here) here = static_cast<std::uint8_t>(beside + 1);
        }
  };
  for (int x = 0; x < n.x(); ++x)
    for (int y = 0; y < n.y(); ++y)
      for (int z = 0; z < n.z(); ++z) visit(x, y, z, 1);
  for (int x = n.x() - 1; x >= 0; --x)
    for (int y = n.y() - 1; y >= 0; --y)
      for (int z = n.z() - 1; z >= 0; --z) visit(x, y, z, -1);
}

}  // namespace

WorkpieceBodies::WorkpieceBodies(const LayeredTooth& tooth)
    : tooth_(&tooth),
      worked_(tooth.bodies->worked()),
      away_(tooth.bodies->of.table_size(), kFar),
      removed_(tooth.bodies->list.size(), 0.0) {
  for (std::size_t b = 0; b < away_.size(); ++b) {
    const std::uint8_t* body = of().brick(b);
    const std::uint8_t* end = body + (of().is_uniform(b) ? 1 : kBrickVoxels);
    if (std::any_of(body, end, [this](std::uint8_t v) { return v != 0 && v != worked_ + 1; }))
      away_[b] = 0;
  }
  spread_distances(of().brick_counts(), away_);
}

int WorkpieceBodies::bricks_to_others(const Index3& voxel) const noexcept {
  Index3 brick(voxel.x() >> 3, voxel.y() >> 3, voxel.z() >> 3);
  const Index3& n = of().brick_counts();
  brick = (brick - of().first_brick()).cwiseMax(0).cwiseMin(n - Index3::Ones());
  return away_[(static_cast<std::size_t>(brick.x()) * n.y() + brick.y()) * n.z() + brick.z()];
}

void WorkpieceBodies::count_removed(std::size_t brick, const float* before,
                                    const float* after) noexcept {
  if (!holds_others(brick)) return;
  const float* solid = tooth_->solid.brick(brick);
  const std::uint8_t* body = of().brick(brick);
  const double voxel = tooth_->lattice.voxel, volume = voxel * voxel * voxel;
  const auto per_voxel = static_cast<float>(1 / voxel);
  const auto inside = [per_voxel](float phi) {
    return std::min(std::max(0.5f - phi * per_voxel, 0.0f), 1.0f);
  };
  for (int v = 0; v < kBrickVoxels; ++v) {
    if (body[v] == 0 || body[v] == worked_ + 1) continue;
    const float gone = inside(std::max(solid[v], before[v])) - inside(std::max(solid[v], after[v]));
    if (gone > 0) removed_[body[v] - 1u] += volume * gone;
  }
}

void WorkpieceBodies::count_removed(const Index3& voxel, double volume) noexcept {
  const std::uint8_t body = of().value(voxel.x(), voxel.y(), voxel.z());
  if (body != 0 && body != worked_ + 1) removed_[body - 1u] += volume;
}

}  // namespace toothprep
