#include "toothprep/tools/device/servo.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/device/tick_clock.h"

namespace toothprep {
namespace {

// The servo whose tick runs on this thread.
thread_local const Servo* ticking = nullptr;

constexpr double kShortestRotation = 1e-6;  // a quaternion's norm, below: not an orientation

// Puts a good reading into `last`, or the last good one into `pose`.
DeviceFault accept(DevicePose& pose, DevicePose& last) noexcept {
  DeviceFault fault = DeviceFault::kNone;
  if (!pose.position.allFinite()) {
    pose.position = last.position;
    fault = DeviceFault::kBadReading;
  }
  const double norm = pose.orientation.norm();
  if (!std::isfinite(norm) || norm < kShortestRotation) {
    pose.orientation = last.orientation;
    fault = DeviceFault::kBadReading;
  }
  last = pose;
  return fault;
}

}  // namespace

Servo::Servo(double max_force, double period, double ramp)
    : max_force_(max_force), period_(period), scale_step_(ramp > 0 ? period / ramp : 1) {
  if (!(std::isfinite(max_force) && max_force > 0))
    throw Error("haptic device: the largest force must be above 0 N");
  if (!(std::isfinite(period) && period > 0))
    throw Error("haptic device: the period of the servo must be above 0 s");
  if (!(std::isfinite(ramp) && ramp >= 0))
    throw Error("haptic device: the ramp must last 0 s or more");
}

void Servo::open(ServoClient& client) noexcept {
  client_ = &client;
  scale_ = last_time_ = 0;
  tick_ = 0;
  any_reading_ = recovering_ = closing_in_this_tick_ = false;
  last_hand_ = last_mirror_ = DevicePose();
  last_force_ = Vec3::Zero();
  pending_ = current_ = DeviceFault::kNone;
  closing_ = sent_zero_ = false;
  ticks_ = faults_ = clamped_ = missed_ = 0;
  time_ = force_x_ = force_y_ = force_z_ = 0;
  ended_ = monotonic_time();
  last_fault_ = DeviceFault::kNone;
  driver_code_ = 0;
  state_ = ServoState::kRunning;
}

Vec3 Servo::begin_tick(double time, const DevicePose& hand, const DevicePose* mirror,
                       DeviceFault fault) noexcept {
  DeviceReading reading;
  reading.tick = tick_;
  reading.time = time;
  reading.hand = hand;
  const DeviceFault reported = std::exchange(pending_, DeviceFault::kNone);  // and recorded then
  fault = worse_of(fault, reported);
  DeviceFault garbled = accept(reading.hand, last_hand_);
  if (mirror) {
    reading.mirror = *mirror;
    garbled = worse_of(garbled, accept(*reading.mirror, last_mirror_));
  }
  fault = worse_of(fault, garbled);
  any_reading_ = any_reading_ || garbled == DeviceFault::kNone;
  if (fault != reported) record(fault);

  closing_in_this_tick_ = closing_ || abandoned_;
  recovering_ = false;
  Vec3 force = Vec3::Zero();
  if (state_ == ServoState::kRunning && !closing_in_this_tick_ && any_reading_) {
    if (tick_ > 0) {
      const double periods = std::clamp((time - last_time_) / period_, 0.0, 1e6);
      reading.missed = std::max(0, static_cast<int>(std::lround(periods)) - 1);
      missed_ = missed_ + reading.missed;
    }
    if (fault == DeviceFault::kNone) {
      recovering_ = scale_ == 0;
      scale_ = std::min(1.0, scale_ + scale_step_);
    } else {
      scale_ = 0;
    }
    reading.fault = fault;
    reading.force_scale = scale_;
    reading.previous_force = last_force_;
    const Vec3 wanted = client_force(reading, fault);
    if (fault != reading.fault) {
      scale_ = 0;
      record(fault);
    }
    force = scale_ * wanted;
    last_time_ = time;
    time_ = time;
    ticks_ = ++tick_;
  }
  current_ = fault;
  last_force_ = force;
  force_x_ = force.x();
  force_y_ = force.y();
  force_z_ = force.z();
  return force;
}

Vec3 Servo::client_force(const DeviceReading& reading, DeviceFault& fault) noexcept {
  Vec3 force = Vec3::Zero();
  const Servo* const outer = std::exchange(ticking, this);
  in_client_ = true;  // before the look at abandoned_: see abandon()
  try {
    if (!abandoned_) force = client_->tick(reading);
  } catch (...) {
    fault = worse_of(fault, DeviceFault::kClient);
  }
  in_client_ = false;
  ticking = outer;
  if (!force.allFinite()) {
    fault = worse_of(fault, DeviceFault::kBadForce);
    return Vec3::Zero();
  }
  if (closing_) {  // the client called stop()
    closing_in_this_tick_ = true;
    return Vec3::Zero();
  }
  const double norm = force.stableNorm();  // finite components may overflow a plain norm
  if (norm > max_force_) {
    clamped_ = clamped_ + 1;
    force *= max_force_ / norm;
  }
  return force;
}

void Servo::end_tick() noexcept {
  ended_ = monotonic_time();
  if (closing_in_this_tick_) sent_zero_ = true;
}

void Servo::report(DeviceFault fault) noexcept {
  if (fault == DeviceFault::kNone) return;
  record(fault);
  current_ = fault;
  pending_ = worse_of(pending_, fault);
}

void Servo::record(DeviceFault fault) noexcept {
  if (fault == DeviceFault::kNone) return;
  if (state_ == ServoState::kFaulted) return;  // the first final fault is reported
  last_fault_ = fault;
  if (fault != current_) faults_ = faults_ + 1;
  if (severity_of(fault) == FaultSeverity::kFinal) {
    ServoState running = ServoState::kRunning;
    state_.compare_exchange_strong(running, ServoState::kFaulted);
  }
}

void Servo::closed() noexcept {
  force_x_ = force_y_ = force_z_ = 0;
  state_ = ServoState::kStopped;
}

void Servo::abandon(double longest) noexcept {
  abandoned_ = true;
  const double deadline = monotonic_time() + longest;
  while (in_client_ && monotonic_time() < deadline) sleep_until(monotonic_time() + 1e-4);
}

bool Servo::in_tick_on_this_thread() const noexcept { return ticking == this; }

DeviceStatus Servo::status() const noexcept {
  DeviceStatus s;
  s.state = state_;
  s.ticks = ticks_;
  s.time = time_;
  s.age = s.state == ServoState::kIdle ? 0 : monotonic_time() - ended_;
  s.force = Vec3(force_x_, force_y_, force_z_);
  s.last_fault = last_fault_;
  s.driver_code = driver_code_;
  s.faults = faults_;
  s.clamped_ticks = clamped_;
  s.missed_ticks = missed_;
  return s;
}

}  // namespace toothprep
