// Teeth cut by exact shapes, whose volumes and distances the tests derive.
#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <mutex>

#include "toothprep/proof/specimen/block.h"
#include "toothprep/proof/specimen/molar.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/compare/solid.h"

namespace toothprep {

using Shape = std::function<double(const Vec3&)>;  // signed distance, mm, negative inside

// What is left of the tooth outside the shape.
inline LayeredTooth carved(LayeredTooth tooth, const Shape& shape) {
  LevelSet solid = tooth.solid;
  const auto band = static_cast<float>(tooth.band());
  std::mutex insert;
  tbb::parallel_for(std::size_t{0}, solid.table_size(), [&](std::size_t b) {
    if (tooth.solid.is_uniform(b) && tooth.solid.uniform_value(b) > 0) return;
    const Index3 first = tooth.solid.brick_origin(b);
    std::array<float, kBrickVoxels> values;
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Vec3 x = tooth.lattice.to_world(first + Index3(v >> 6, (v >> 3) & 7, v & 7));
      const auto cut = static_cast<float>(std::clamp<double>(-shape(x), -band, band));
      values[v] = std::max(tooth.solid.brick(b)[v], cut);
    }
    const std::lock_guard lock(insert);
    solid.set_brick(b, values.data());
  });
  apply_remaining_solid(tooth, std::move(solid));
  return tooth;
}

// Exact signed distance to the box [low, high] of a frame that stands at `pose`.
inline Shape box_shape(const Vec3& low, const Vec3& high, const Pose& pose = {}) {
  return [=](const Vec3& world) {
    const Vec3 q = (pose.to_local(world) - (low + high) / 2).cwiseAbs() - (high - low) / 2;
    return q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0);
  };
}

inline Shape ball_shape(const Vec3& centre, double radius) {
  return [=](const Vec3& x) { return (x - centre).norm() - radius; };
}

inline Pose pose_of(const Vec3& position, const Vec3& axis, double degrees) {
  return {position, Quat(Eigen::AngleAxisd(units::from_degree(degrees), axis.normalized()))};
}

// An odd angle and an odd place between the voxels.
inline Pose odd_pose() { return pose_of(Vec3(0.237, -0.113, 0.071), Vec3(0.3, 1, -0.4), 23.7); }

inline LayeredTooth block(double voxel, const Pose& pose = {}) {
  BlockOptions options;
  options.voxel = voxel;
  options.pose = pose;
  return make_block(options);  // 8 x 8 x 8 mm, top face at y = 0, enamel down to -2
}

inline LayeredTooth molar(double voxel) {
  MolarOptions options;
  options.voxel = voxel;
  return make_molar(options);
}

// A class I box in the molar's central fossa: 4 mm long, 2 mm wide, floor at z = 14.5.
inline Shape class_one(double deeper = 0) {
  return box_shape(Vec3(5.1, 3.5, 14.5 - deeper), Vec3(7.1, 7.5, 25));
}

}  // namespace toothprep
