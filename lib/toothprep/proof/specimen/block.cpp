#include "toothprep/proof/specimen/block.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/errors.h"

namespace toothprep {

double box_distance(const Vec3& x, const Vec3& low, const Vec3& high) {
  const Vec3 q = (x - (low + high) / 2).cwiseAbs() - (high - low) / 2;
  return q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0);
}

BoxGrid grid_of_box(const Vec3& low, const Vec3& high, double voxel, const Pose& pose) {
  BoxGrid grid;
  grid.lattice.voxel = voxel;
  grid.lattice.origin =
      pose.position + Vec3(voxel / 2, -voxel / 2, voxel / 2) + Vec3(low.x(), high.y(), low.z());
  Vec3 world_low = Vec3::Constant(1e30), world_high = Vec3::Constant(-1e30);
  for (int c = 0; c < 8; ++c) {
    const Vec3 corner((c & 1) ? high.x() : low.x(), (c & 2) ? high.y() : low.y(),
                      (c & 4) ? high.z() : low.z());
    world_low = world_low.cwiseMin(pose.to_world(corner));
    world_high = world_high.cwiseMax(pose.to_world(corner));
  }
  grid.lower = grid.lattice.to_index(world_low).array().floor().matrix().cast<int>();
  grid.upper = grid.lattice.to_index(world_high).array().ceil().matrix().cast<int>();
  return grid;
}

LayeredTooth make_block(const BlockOptions& o) {
  if (!o.size.allFinite() || o.size.minCoeff() <= 0 || o.size.maxCoeff() > 200)
    throw Error("block: size must lie in (0, 200] mm");
  if (!(o.enamel >= 0 && o.enamel <= o.size.y()))
    throw Error("block: enamel must lie between 0 and the block's height of " +
                fmt::format("{:g} mm", o.size.y()));
  if (!(o.voxel > 0 && o.voxel <= o.size.minCoeff() / 2))
    throw Error("block: the voxel size must be positive and at most half the smallest side");
  const Vec3 low(-o.size.x() / 2, -o.size.y(), -o.size.z() / 2);
  const Vec3 high(o.size.x() / 2, 0, o.size.z() / 2);
  const double border = -o.enamel;

  const auto [lattice, lower, upper] = grid_of_box(low, high, o.voxel, o.pose);
  const bool turned = !o.pose.orientation.vec().isZero(0);

  return build_tooth(
      lattice, lower, upper,
      [&](const Vec3& world) {
        const Vec3 x = turned ? o.pose.to_local(world) : Vec3(world - o.pose.position);
        ToothSample s;
        const double none = 1e3;
        const double d = box_distance(x, low, high);
        s.solid = static_cast<float>(d);
        s.tissue = {static_cast<float>(o.enamel > 0 ? std::max(d, border - x.y()) : none),
                    static_cast<float>(o.enamel < o.size.y() ? std::max(d, x.y() - border) : none),
                    static_cast<float>(none)};
        // A centre that lies on the border to rounding belongs to the enamel.
        if (d < 0)
          s.label = x.y() > border - 1e-9 && o.enamel > 0 ? Tissue::kEnamel : Tissue::kDentin;
        return s;
      },
      true);
}

}  // namespace toothprep
