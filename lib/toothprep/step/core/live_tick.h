// What one servo tick of a live session leaves behind: the step's row, and what the device and the
// limits made of it. Plain values, so that a tick can hand it on without allocating.
//
// Frames: W of the tooth (the row), D of the device (haptic_device.h).
#pragma once

#include <cstdint>
#include <type_traits>

#include "toothprep/step/core/session_event.h"
#include "toothprep/step/core/step_record.h"

namespace toothprep {

// What was done to a tick's force, bit by bit.
enum LiveFlag : std::uint32_t {
  kForceClamped = 1,       // above the force limit; direction kept
  kForceRateLimited = 2,   // changed faster than allowed
  kForceHeatLimited = 4,   // above the motors' continuous force, for too long
  kForceNotFinite = 8,     // the step gave a force that is no number: zero was sent
  kForceRamped = 16,       // the device's ramp scaled it
  kForceWithheld = 32,     // not sent for another reason: a fault, stopping, a governor
  kHandleHeld = 64,        // the clutch: the handle did not follow the hand
  kReadingRejected = 128,  // the reading can't be believed: zero force, no step
  kMotorLocked = 256,      // the motor waits for a safe start: see LiveLoop
  kSwitchHeld = 512,       // the device has a safety switch, and the hand holds it
  kSwitchOpen = 1024,      // it has one, and the hand doesn't
  kPaused = 2048,          // the session is paused (session_event.h): zero force, no step
};

struct LiveTick {  // a tick of a live session, with the step that it made
  StepRecord row;  // its time is (number of steps) * time step: what a replay steps through

  // The device's side.
  std::int64_t tick = 0;                       // of the device, from 0
  double servo_time = 0;                       // s since the servo's start, when the tick began
  std::int32_t missed = 0;                     // periods without a tick before this one
  Vec3 device_position = Vec3::Zero();         // mm, D, as read
  Quat device_orientation = Quat::Identity();  // stylus to D
  std::uint32_t device_buttons = 0;            // bits
  bool has_mirror = false;                     // the second device's pose, in its own frame D
  Vec3 mirror_position = Vec3::Zero();         // mm
  Quat mirror_orientation = Quat::Identity();  // stylus to D
  std::uint32_t mirror_buttons = 0;            // bits
  Vec3 commanded_force = Vec3::Zero();         // N, D: after all limits, what the client returned
  Vec3 sent_force =
      Vec3::Zero();         // N, D: what the device says that it sent in the tick before this
  double force_scale = 0;   // of the device's ramp, in this tick
  std::uint32_t flags = 0;  // LiveFlag
  std::uint32_t fault = 0;  // DeviceFault, of this tick
  double step_seconds = 0;  // CPU time of this tick's work on the servo's thread
  SessionEvent event;       // what was done to the session with this row
};

}  // namespace toothprep
