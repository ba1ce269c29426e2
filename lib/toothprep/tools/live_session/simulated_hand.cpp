#include "toothprep/tools/live_session/simulated_hand.h"

#include <cmath>

#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

Pose in_device_frame(const Pose& w, const Registration& r, const Vec3& start) {
  const Quat to_device = r.rotation.conjugate();
  return {to_device * (w.position - r.translation.value_or(start)),
          to_device * w.orientation * r.stylus_to_bur.conjugate()};
}

}  // namespace

HandMotion hand_along_world_path(std::vector<HandleSample> path, const Registration& registration,
                                 const Vec3& start) {
  const double from = path.empty() ? 0 : path.front().time;
  for (HandleSample& sample : path) {
    sample.time -= from;
    sample.pose = in_device_frame(sample.pose, registration, start);
  }
  return hand_along(std::move(path));
}

HandMotion hand_in_loops(const Registration& registration, const Vec3& start) {
  const Quat upright = orientation_of_axis(registration.rotation * Vec3::UnitY());
  const Pose at = in_device_frame({start, upright}, registration, start);
  DevicePose centre;
  centre.position = at.position;
  centre.orientation = at.orientation;
  centre.buttons = 1;
  return gentle_hand(centre, Vec3(2, 1, 2));
}

HandMotion hand_for(const Protocol& protocol) {
  constexpr double kSpeed = 0.5;                  // mm/s
  constexpr double kSwing = 1, kFrequency = 0.5;  // mm, Hz
  return [kind = protocol.kind](double time) {
    DevicePose pose;
    if (kind == ProtocolKind::kDampingSweep) pose.position.x() = kSpeed * time;
    if (kind == ProtocolKind::kWall) pose.position.y() = -kSpeed * time;
    if (kind == ProtocolKind::kStiffnessSweep)
      pose.position.x() = kSwing * std::sin(2 * units::kPi * kFrequency * time);
    return pose;
  };
}

}  // namespace toothprep
