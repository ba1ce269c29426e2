// Vectors and poses. Frames: W world (the scan's physical frame, mm, LPS), B bur (origin at the tip
// on the rotation axis, +z from tip to shank), H handle (the pose commanded by hand, for the bur's
// tip).
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace toothprep {

using Vec3 = Eigen::Vector3d;     // x, y, z
using Mat3 = Eigen::Matrix3d;     // 3 x 3, column-major
using Quat = Eigen::Quaterniond;  // constructed as w, x, y, z; files hold x, y, z, w
using Index3 = Eigen::Vector3i;   // of a voxel or a brick

// A rigid placement: x_W = position + orientation * x_B. position in mm; orientation a unit
// quaternion.
struct Pose {
  Vec3 position = Vec3::Zero();         // mm
  Quat orientation = Quat::Identity();  // unit

  Vec3 to_world(const Vec3& x) const { return position + orientation * x; }  // x in B or H, mm
  Vec3 to_local(const Vec3& x) const { return orientation.conjugate() * (x - position); }  // in W
};

// The rotation that takes B's +z to `axis` (tip to shank) by the shortest arc, then turns by `spin`
// radians about it. Throws nothing; `axis` must not be zero.
[[nodiscard]] inline Quat orientation_of_axis(const Vec3& axis, double spin = 0.0) {
  return (Quat::FromTwoVectors(Vec3::UnitZ(), axis.normalized()) *
          Quat(Eigen::AngleAxisd(spin, Vec3::UnitZ())))
      .normalized();
}

}  // namespace toothprep
