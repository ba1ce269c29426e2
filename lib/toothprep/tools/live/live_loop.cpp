#include "toothprep/tools/live/live_loop.h"

#include "toothprep/tools/live/tick_cost.h"

namespace toothprep {

LiveLoop::LiveLoop(const ForceLimits& limits, const LiveButtons& buttons, TickSink* sink,
                   const ReadingLimits& readings)
    : buttons_(buttons), sink_(sink), governor_(limits), check_(readings) {}

std::optional<DevicePose> LiveLoop::waiting_pose() const noexcept {
  if (!has_pose_.load(std::memory_order_acquire)) return {};
  const auto at = [this](std::size_t i) { return pose_[i].load(std::memory_order_relaxed); };
  DevicePose pose;
  pose.position = Vec3(at(0), at(1), at(2));
  pose.orientation = Quat(at(6), at(3), at(4), at(5)).normalized();  // may be of two ticks
  return pose;
}

void LiveLoop::begin(Session& session, const HandleFrame& frame, const Registration& registration,
                     const std::optional<Vec3>& start, double time_step) noexcept {
  session_ = &session;
  frame_ = frame;
  registration_ = registration;
  start_ = start;
  time_step_ = time_step;
  phase_.store(Phase::kBeginning, std::memory_order_release);
}

Vec3 LiveLoop::tick(const DeviceReading& reading) {
  const double from = thread_seconds();
  const Phase phase = phase_.load(std::memory_order_acquire);
  const ReadingFault fault = check_.judge(reading);
  if (phase == Phase::kWaiting) {
    wait(reading, fault);
    return Vec3::Zero();
  }

  LiveTick out;
  note_reading(reading, out);

  if (phase == Phase::kBeginning) {
    if (fault != ReadingFault::kNone) return Vec3::Zero();
    if (start_) frame_.emplace(registration_, reading.hand.position, *start_);
    out.row = session_->initial();
    phase_.store(Phase::kRunning, std::memory_order_relaxed);
  } else {
    step(reading, fault, out);
  }
  out.step_seconds = thread_seconds() - from;
  hand_on(out);
  status_.write(out, steps_, governor_);
  status_.write(fault, check_.lost(), let_go(reading.hand));
  return out.commanded_force;
}

void LiveLoop::wait(const DeviceReading& reading, ReadingFault fault) noexcept {
  status_.write(fault, check_.lost(), let_go(reading.hand));
  if (fault != ReadingFault::kNone || reading.fault != DeviceFault::kNone) return;
  const DevicePose& hand = reading.hand;
  for (std::size_t i = 0; i < 3; ++i)
    pose_[i].store(hand.position[static_cast<Eigen::Index>(i)], std::memory_order_relaxed);
  for (std::size_t i = 0; i < 4; ++i)
    pose_[3 + i].store(hand.orientation.coeffs()[static_cast<Eigen::Index>(i)],
                       std::memory_order_relaxed);
  has_pose_.store(true, std::memory_order_release);
}

// The safety switch: nobody holds the stylus.
bool LiveLoop::let_go(const DevicePose& hand) const noexcept {
  return buttons_.safety_switch && !hand.safety_switch.value_or(true);
}

// What the session gets of the buttons.
std::uint32_t LiveLoop::motor_buttons(std::uint32_t pressed, LiveTick& out) noexcept {
  const bool wanted = buttons_.pedal == 0 || (pressed & buttons_.pedal) != 0;
  if (!unlocked_) {
    if (buttons_.pedal != 0) {
      unlocked_ = !wanted;
    } else {
      clear_ = session_->clear_of_tissue() ? clear_ + time_step_ : 0;
      unlocked_ = clear_ >= kClearBefore;
    }
    if (!unlocked_ && wanted) out.flags |= kMotorLocked;
  }
  return wanted && unlocked_ ? kPedalButton : 0;
}

void LiveLoop::step(const DeviceReading& reading, ReadingFault fault, LiveTick& out) noexcept {
  const DevicePose& hand = reading.hand;
  const bool rejected = fault != ReadingFault::kNone;
  const bool held = (hand.buttons & buttons_.clutch) != 0;
  HandleSample next;
  next.time = static_cast<double>(++steps_) * time_step_;
  next.rejected = rejected;
  if (rejected) {
    out.flags |= kReadingRejected | kForceWithheld;
  } else if (held) {
    frame_->hold(hand.position, hand.orientation);
    out.flags |= kHandleHeld;
  } else {
    frame_->release(hand.position, hand.orientation);
  }
  next.pose = frame_->to_world(hand.position, hand.orientation);
  const bool free = let_go(hand);
  if (free) unlocked_ = false, clear_ = 0;
  next.buttons = free ? 0 : motor_buttons(hand.buttons, out);
  out.row = session_->step(next);

  Vec3 force = frame_->force_to_device(out.row.device_force);
  if (rejected || check_.resumed()) governor_.restart();
  const bool withheld = reading.fault != DeviceFault::kNone || free;
  governor_.fade_out(held || fade_wanted_.load(std::memory_order_relaxed));
  out.commanded_force =
      withheld ? governor_.withhold(out.flags) : governor_.limit(force, out.flags);
}

void LiveLoop::hand_on(const LiveTick& tick) noexcept {
  if (any_ && sink_) sink_->take(last_);
  last_ = tick;
  any_ = true;
}

void LiveLoop::finish() noexcept {
  if (!any_) return;
  session_->finish(last_.row);
  if (sink_) sink_->take(last_);
  any_ = false;
}

}  // namespace toothprep
