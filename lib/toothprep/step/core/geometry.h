// Vectors and poses. Frames: W world (the scan's physical frame, mm, LPS), B bur (origin at the tip
// on the rotation axis, +z from tip to shank), H handle (the pose commanded by hand, for the bur's
// tip).
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace toothprep {

using Vec3 = Eigen::Vector3d;
using Mat3 = Eigen::Matrix3d;
using Quat = Eigen::Quaterniond;
using Index3 = Eigen::Vector3i;

// A rigid placement: x_W = position + orientation * x_B. position in mm; orientation a unit
// quaternion.
struct Pose {
  Vec3 position = Vec3::Zero();
  Quat orientation = Quat::Identity();

  Vec3 to_world(const Vec3& x) const { return position + orientation * x; }
  Vec3 to_local(const Vec3& x) const { return orientation.conjugate() * (x - position); }
};

// The rotation that takes B's +z to `axis` (tip to shank) by the shortest arc, then turns by `spin`
// radians about it. Throws nothing; `axis` must not be zero.
inline Quat orientation_of_axis(const Vec3& axis, double spin = 0.0) {
  return (Quat::FromTwoVectors(Vec3::UnitZ(), axis.normalized()) *
          Quat(Eigen::AngleAxisd(spin, Vec3::UnitZ())))
      .normalized();
}

}  // namespace toothprep
