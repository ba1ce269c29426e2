#include "toothprep/tools/live/live_loop.h"

#include "toothprep/step/session/intervals.h"
#include "toothprep/tools/live/tick_cost.h"

namespace toothprep {

LiveLoop::LiveLoop(const ForceLimits& limits, const LiveButtons& buttons, TickSink* sink,
                   const ReadingLimits& readings)
    : buttons_(buttons), sink_(sink), governor_(limits), check_(readings) {}

std::optional<DevicePose> LiveLoop::waiting_pose() const noexcept {
  if (!has_pose_.load(std::memory_order_acquire)) return {};
  const Pose at = paused_handle();
  DevicePose pose;
  pose.position = at.position;
  pose.orientation = at.orientation;
  return pose;
}

Pose LiveLoop::paused_handle() const noexcept {
  const auto at = [this](std::size_t i) { return pose_[i].load(std::memory_order_relaxed); };
  return {Vec3(at(0), at(1), at(2)),
          Quat(at(6), at(3), at(4), at(5)).normalized()};  // may be of two ticks
}

// The hand's in the device's frame while it waits, the handle's in W in a pause.
void LiveLoop::store_pose(const Pose& pose) noexcept {
  for (std::size_t i = 0; i < 3; ++i)
    pose_[i].store(pose.position[static_cast<Eigen::Index>(i)], std::memory_order_relaxed);
  for (std::size_t i = 0; i < 4; ++i)
    pose_[3 + i].store(pose.orientation.coeffs()[static_cast<Eigen::Index>(i)],
                       std::memory_order_relaxed);
}

bool LiveLoop::post(const LiveCommand& command) noexcept {
  if (posted()) return false;
  command_ = command;
  posted_.store(true, std::memory_order_release);
  return true;
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
  } else if (!obey(fault, out)) {
    phase == Phase::kPaused ? stand(reading, fault, out) : step(reading, fault, out);
  }
  out.step_seconds = thread_seconds() - from;
  hand_on(out);
  if (phase == Phase::kRunning && out.event.kind == EventKind::kPause) {
    hand_on({});  // the row is whole; from here on session and workpiece are left alone
    any_ = false;
    phase_.store(Phase::kPaused, std::memory_order_release);
  }
  status_.write(out, steps_, governor_);
  status_.write(fault, check_.lost(), let_go(reading.hand));
  return out.commanded_force;
}

void LiveLoop::wait(const DeviceReading& reading, ReadingFault fault) noexcept {
  status_.write(fault, check_.lost(), let_go(reading.hand));
  if (fault != ReadingFault::kNone || reading.fault != DeviceFault::kNone) return;
  store_pose({reading.hand.position, reading.hand.orientation});
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

HandleSample LiveLoop::next_handle(const DeviceReading& reading, ReadingFault fault,
                                   LiveTick& out) noexcept {
  const DevicePose& hand = reading.hand;
  HandleSample next;
  next.time = static_cast<double>(++steps_) * time_step_;
  next.rejected = fault != ReadingFault::kNone;
  if (next.rejected) {
    out.flags |= kReadingRejected | kForceWithheld;
  } else if ((hand.buttons & buttons_.clutch) != 0) {
    frame_->hold(hand.position, hand.orientation);
    out.flags |= kHandleHeld;
  } else {
    frame_->release(hand.position, hand.orientation);
  }
  next.pose = frame_->to_world(hand.position, hand.orientation);
  return next;
}

void LiveLoop::step(const DeviceReading& reading, ReadingFault fault, LiveTick& out) noexcept {
  HandleSample next = next_handle(reading, fault, out);
  const bool free = let_go(reading.hand);
  if (free) unlocked_ = false, clear_ = 0;
  next.buttons = free || pausing_ ? 0 : motor_buttons(reading.hand.buttons, out);
  out.row = session_->step(next);
  add_removed(removed_, out.row.removed_volume);

  Vec3 force = frame_->force_to_device(out.row.device_force);
  if (next.rejected || check_.resumed()) governor_.restart();
  const bool withheld = reading.fault != DeviceFault::kNone || free;
  const bool held = (reading.hand.buttons & buttons_.clutch) != 0;
  governor_.fade_out(held || pausing_ || fade_wanted_.load(std::memory_order_relaxed));
  out.commanded_force =
      withheld ? governor_.withhold(out.flags) : governor_.limit(force, out.flags);
  if (!pausing_ || !governor_.faded()) return;
  complete(out.row);
  pausing_ = false;
  session_ = nullptr;
  stands_ = out.row.bur;
  removed_ = out.row.removed_volume;
  store_pose(out.row.handle.pose);
  out.event.kind = EventKind::kPause;
}

// A row without a step and without a force.
void LiveLoop::stand(const DeviceReading& reading, ReadingFault fault, LiveTick& out) noexcept {
  out.row.handle = next_handle(reading, fault, out);
  out.row.handle.rejected = true;
  out.row.handle.buttons = 0;
  out.row.bur = stands_;
  out.row.removed_volume = removed_;
  out.flags |= kPaused;
  if (fault == ReadingFault::kNone) store_pose(out.row.handle.pose);
  governor_.fade_out(true);
  out.commanded_force = governor_.limit(Vec3::Zero(), out.flags);
}

// A command that waits; whether it made the tick's row.
bool LiveLoop::obey(ReadingFault fault, LiveTick& out) noexcept {
  if (!posted()) return false;
  const bool resumes = command_.kind == EventKind::kResume;
  if (resumes && fault != ReadingFault::kNone) return false;  // with a reading that can be believed
  out.event = {0, command_.kind, command_.arguments};
  switch (command_.kind) {
    case EventKind::kPause:  // its event comes when it is one
      out.event = {};
      pausing_ = true;
      break;
    case EventKind::kRegistration: {
      frame_->move(command_.shift, command_.turn, paused_handle().position);
      const Pose to = frame_->device_to_world();
      Eigen::Map<Vec3>(out.event.arguments.data()) = to.position;
      Eigen::Map<Eigen::Vector4d>(out.event.arguments.data() + 3) = to.orientation.coeffs();
      break;
    }
    case EventKind::kUndo:
      removed_ = command_.removed;
      break;
    case EventKind::kResume:
      session_ = command_.session;
      removed_ = command_.removed;
      unlocked_ = false, clear_ = 0;
      out.row = session_->initial();
      out.row.handle.time = static_cast<double>(++steps_) * time_step_;
      add_removed(removed_, out.row.removed_volume);
      governor_.restart();
      phase_.store(Phase::kRunning, std::memory_order_relaxed);
      break;
    default:
      break;
  }
  posted_.store(false, std::memory_order_release);
  return resumes;
}

// What is still due is removed with the row.
void LiveLoop::complete(StepRecord& row) noexcept {
  session_->finish(row);
  add_removed(removed_, row.removed_volume);
}

void LiveLoop::hand_on(const LiveTick& tick) noexcept {
  if (any_ && sink_) sink_->take(last_);
  last_ = tick;
  any_ = true;
}

void LiveLoop::finish() noexcept {
  if (!any_) return;
  if (session_) complete(last_.row);
  if (sink_) sink_->take(last_);
  any_ = false;
}

}  // namespace toothprep
