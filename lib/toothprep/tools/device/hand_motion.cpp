#include "toothprep/tools/device/hand_motion.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep {

HandMotion resting_hand(const DevicePose& pose) {
  if (!pose.position.allFinite()) throw Error("hand motion: the position is not finite");
  return [pose](double) { return pose; };
}

HandMotion gentle_hand(const DevicePose& center, const Vec3& amplitude, double frequency) {
  if (!center.position.allFinite() || !amplitude.allFinite() || !std::isfinite(frequency))
    throw Error("hand motion: centre, amplitude and frequency must be finite");
  return [center, amplitude, frequency](double time) {
    const double phase = 2 * units::kPi * frequency * time;
    DevicePose pose = center;
    pose.position +=
        amplitude.cwiseProduct(Vec3(std::sin(phase), std::sin(1.5 * phase), std::sin(0.5 * phase)));
    return pose;
  };
}

HandMotion hand_along(std::vector<HandleSample> path) {
  if (path.empty()) throw Error("hand motion: the path has no samples");
  for (std::size_t i = 0; i < path.size(); ++i) {
    const HandleSample& s = path[i];
    if (!std::isfinite(s.time) || !s.pose.position.allFinite() ||
        !s.pose.orientation.coeffs().allFinite())
      throw Error("hand motion: sample " + std::to_string(i) + " is not finite");
    if (i > 0 && !(s.time > path[i - 1].time))
      throw Error("hand motion: the time does not increase at sample " + std::to_string(i));
  }
  return [path = std::move(path)](double time) {
    const double at = path.front().time + std::max(0.0, time);
    // The first sample behind `at`.
    const auto next = std::upper_bound(path.begin(), path.end(), at,
                                       [](double t, const HandleSample& s) { return t < s.time; });
    DevicePose pose;
    const HandleSample& a = *(next - 1);
    pose.buttons = a.buttons;
    if (next == path.end()) {
      pose.position = a.pose.position;
      pose.orientation = a.pose.orientation;
      return pose;
    }
    const double part = (at - a.time) / (next->time - a.time);
    pose.position = a.pose.position + part * (next->pose.position - a.pose.position);
    pose.orientation = a.pose.orientation.slerp(part, next->pose.orientation);
    return pose;
  };
}

}  // namespace toothprep
