// The tissue that lies deep in a bur's head, of what isn't cut yet.
#pragma once

#include <algorithm>
#include <cmath>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/geometry.h"
#include "toothprep/step/grinding/workpiece.h"

namespace toothprep {

constexpr double kColumnRounding = 1e-6;  // voxels

// Calls found(brick, voxel in it, place, label) for every voxel of tissue that isn't cut and whose
// centre lies more than `depth` (mm, not negative) beneath the surface of the head at `pose`.
template <class Found>
void for_deep_voxels(const Bur& bur, const Workpiece& workpiece, const Pose& pose, double depth,
                     const Found& found) {
  const LabelGrid& labels = workpiece.tooth().tissue;
  const LevelSet& cut = workpiece.cut();  // over the same bricks
  const double voxel = workpiece.voxel();
  const Vec3 tip = workpiece.lattice().to_index(pose.position);
  const Vec3 end = tip + pose.orientation * Vec3(0, 0, bur.head_length() / voxel);
  const Mat3 to_bur = pose.orientation.toRotationMatrix().transpose() * voxel;
  const Index3 first = cut.first_brick() * kBrickEdge;
  const Index3 last = first + cut.brick_counts() * kBrickEdge - Index3::Ones();
  const double grow = bur.max_radius() / voxel;
  Index3 low, high;
  for (int a = 0; a < 3; ++a) {
    low[a] = static_cast<int>(std::clamp(std::ceil(std::min(tip[a], end[a]) - grow),
                                         double(first[a]), double(last[a]) + 1));
    high[a] = static_cast<int>(std::clamp(std::floor(std::max(tip[a], end[a]) + grow),
                                          double(first[a]) - 1, double(last[a])));
  }
  // What is deep is no farther from the axis, and no nearer to the tip; and more than rounding.
  const double widest = bur.max_radius() - depth + 1e-9, lowest = depth - 1e-9;
  for (int x = low.x(); x <= high.x(); ++x)
    for (int y = low.y(); y <= high.y(); ++y)
      for (int z = low.z(), last_z = 0; z <= high.z(); z = last_z + 1) {  // a brick's at a time
        last_z = std::min(high.z(), z | (kBrickEdge - 1));
        const auto brick = static_cast<std::size_t>(cut.brick_index(x, y, z));
        if (labels.is_uniform(brick) && labels.uniform_value(brick) == 0) continue;
        const auto* its_labels = labels.brick(brick);
        const auto* is_cut = cut.brick(brick);
        for (int at = brick_offset(x & 7, y & 7, z & 7); z <= last_z; ++z, ++at) {
          const std::uint8_t label = its_labels[at];
          if (label == 0 || is_cut[at] > 0) continue;
          const Vec3 b = to_bur * (Vec3(x, y, z) - tip);
          const double square = b.head<2>().squaredNorm();
          if (b.z() < lowest || square > widest * widest) continue;
          const double d = bur.distance(std::sqrt(square), b.z());
          if (!(d < -depth)) {
            // A distance changes by no more than the way, so the next ones aren't deep either.
            const int more = static_cast<int>(
                std::min<double>(kBrickEdge, (d + depth) / voxel - kColumnRounding));
            z += more, at += more;
            continue;
          }
          found(brick, at, Index3(x, y, z), label);
          is_cut = cut.brick(brick);  // may be elsewhere now
        }
      }
}

}  // namespace toothprep
