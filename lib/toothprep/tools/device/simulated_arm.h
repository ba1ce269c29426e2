// A simulated device in a simulated hand that follows an intended motion, as a driver sees it: a
// reading at each tick's start, a force held until the next. What the simulated back end and the
// stand-in for the vendor's library have in common.
#pragma once

#include <cmath>
#include <utility>

#include "toothprep/tools/device/disturbances.h"
#include "toothprep/tools/device/hand_motion.h"
#include "toothprep/tools/device/simulated_phantom.h"

namespace toothprep {

class SimulatedArm {
 public:
  // At rest where the hand intends to be at time 0. Throws Error as the parts' checks do.
  SimulatedArm(const PhantomModel& model, const HandModel& hand, HandMotion motion,
               const Disturbances& disturbances)
      : motion_(std::move(motion)),
        disturbances_(disturbances),
        phantom_(model, hand, motion_(0).position) {}

  // At the start of the tick at `time` (s): position from the encoders, orientation and buttons
  // from the motion.
  DevicePose read(double time) noexcept {
    DevicePose pose = motion_(time);
    const double count = phantom_.model().encoder_count;
    pose.position = phantom_.true_position() + disturbances_.encoder_noise();
    if (count > 0) pose.position = count * (pose.position.array() / count + 0.5).floor().matrix();
    return pose;
  }

  // The motors hold `force` (N) from the tick at `time` to the next.
  void advance(const Vec3& force, double time) noexcept {
    phantom_.tick(force, motion_(time + phantom_.model().time_step()).position);
  }

  bool misses(long tick) const noexcept { return disturbances_.misses(tick); }
  double lateness(long tick) noexcept { return disturbances_.lateness(tick); }
  const SimulatedPhantom& phantom() const noexcept { return phantom_; }

 private:
  HandMotion motion_;
  DisturbanceSource disturbances_;
  SimulatedPhantom phantom_;
};

}  // namespace toothprep
