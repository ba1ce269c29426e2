#include "toothprep/tools/live/live_loop.h"

#include "toothprep/tools/live/tick_cost.h"

namespace toothprep {

LiveLoop::LiveLoop(const ForceLimits& limits, const LiveButtons& buttons, TickSink* sink)
    : buttons_(buttons), sink_(sink), governor_(limits) {}

std::optional<DevicePose> LiveLoop::first_pose() const noexcept {
  if (!has_first_.load(std::memory_order_acquire)) return {};
  return first_;
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
  if (phase == Phase::kWaiting) {
    if (!has_first_.load(std::memory_order_relaxed) && reading.fault == DeviceFault::kNone) {
      first_ = reading.hand;
      has_first_.store(true, std::memory_order_release);
    }
    return Vec3::Zero();
  }

  LiveTick out;
  note_reading(reading, out);

  if (phase == Phase::kBeginning) {
    if (start_) frame_.emplace(registration_, reading.hand.position, *start_);
    out.row = session_->initial();
    phase_.store(Phase::kRunning, std::memory_order_relaxed);
  } else {
    step(reading, out);
  }
  out.step_seconds = thread_seconds() - from;
  hand_on(out);
  status_.write(out, steps_, governor_);
  return out.commanded_force;
}

void LiveLoop::step(const DeviceReading& reading, LiveTick& out) noexcept {
  const DevicePose& hand = reading.hand;
  if ((hand.buttons & buttons_.clutch) != 0) {
    frame_->hold(hand.position);
    out.flags |= kHandleHeld;
  } else {
    frame_->release(hand.position);
  }
  HandleSample next;
  next.time = static_cast<double>(++steps_) * time_step_;
  next.pose = frame_->to_world(hand.position, hand.orientation);
  next.buttons = buttons_.pedal == 0 || (hand.buttons & buttons_.pedal) != 0 ? kPedalButton : 0;
  out.row = session_->step(next);

  Vec3 force = frame_->force_to_device(out.row.device_force);
  if (reading.fault != DeviceFault::kNone) {
    governor_.restart();
    force.setZero();
    out.flags |= kForceWithheld;
  }
  out.commanded_force = governor_.limit(force, out.flags);
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
