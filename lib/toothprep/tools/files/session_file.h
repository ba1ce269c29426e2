// Recordings of live sessions (.h5): a trace (trace.h) with what the device did beside it.
//
// While a session runs the file grows: it is opened for writing by one and reading by many (HDF5's
// SWMR; h5py.File(f, "r", swmr=True)), flushed every quarter of a second, so that a program that is
// killed loses little more than that. Beyond the datasets of a trace, a row per tick:
//
//   /servo/time               s      when the tick began, since the servo's start
//   /servo/tick               1      the device's count
//   /servo/missed             1      periods without a tick before this one
//   /servo/step_time          s      CPU time of the tick's work
//   /servo/flags              1      LiveFlag
//   /servo/fault              1      DeviceFault
//   /servo/force_commanded    N x3   frame D, after all limits
//   /servo/force_sent         N x3   frame D, what the device sent in the tick before
//   /servo/force_scale        1      of the device's ramp
//   /device/position          mm x3  frame D, as read
//   /device/orientation       1 x4   x, y, z, w
//   /device/buttons           1      bits
//   /mirror/position, /mirror/orientation, /mirror/buttons: the same of a second device
//
// Of a session that can be controlled from outside, a row per event (core/session_event.h):
//
//   /events/time              s      of the row with which it happened
//   /events/kind              1      EventKind
//   /events/arguments         1 x7   of the event, else 0
//
// With the first of them schema_version becomes 2, which readers that know none refuse; event_burs
// lists the burs that it could change to, a line each.
//
// and root attributes: live = 1, complete (0 until it was closed), device_* (identity and limits),
// the session's limits, registration_* (D to W, and where the hand was then: not a number before the
// first row), dropped_ticks, end_reason, checksums (h5_checksums.h).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/core/geometry.h"
#include "toothprep/tools/files/trace.h"
#include "toothprep/tools/io/read_policy.h"

namespace toothprep {

// What a session was watched by; data/rig/README.md says what each does.
struct SafetyLimits {
  double force_ramp = 0, force_fade = 0;           // s, in and out
  double stale = 0, frozen = 0;                    // s, without a tick; of the same pose
  double vibration_force = 0, vibration_time = 0;  // N, s
  double heat_time = 0;                            // s
  double speed = 0;                                // mm/s
};

// What a session knows before its first tick. Limits in the units of haptic_device.h.
struct SessionHeader {
  Trace trace;              // parameters, hashes, bur, drive, engine; no rows
  std::string device_kind;  // "openhaptics" or "simulated"
  std::string device_name, device_model, device_vendor, device_driver, device_serial,
      device_firmware;       // as DeviceIdentity; empty: unknown
  std::string mirror_model;  // empty: no second device
  double rate_hz = 0, max_force_n = 0, max_continuous_force_n = 0, max_stiffness_n_per_mm = 0,
         max_damping_n_s_per_mm = 0;                                // as DeviceLimits
  Vec3 workspace_min = Vec3::Zero(), workspace_max = Vec3::Zero();  // mm, D
  std::vector<std::string> limit_notes;                             // as DeviceLimits::notes
  double force_limit_n = 0, force_rate_limit_n_per_s = 0;           // the session's own
  std::optional<SafetyLimits> safety;                               // absent: of version 0.1
  std::string safety_switch;                                        // "used", "ignored"
  Pose registration;                                                // D to W; of the start
  // The registration's position was laid so that the hand starts at a given place: it follows from
  // the first row, and before that it isn't known (then it reads as zero).
  bool laid_at_start = false;
  std::optional<Pose> registration_hand;  // D: in the first row; read only
  std::string protocol;  // of an active check: "rest", "step", ...; empty: a free session
  std::string pedal;     // which button starts the bur: "1", "2", "none"
  std::string host;      // machine, kernel, scheduling: a line
};

struct SessionRecording {  // a whole recording in memory
  SessionHeader header;    // its trace has the rows and, if the session was closed, the audit
  bool complete = false;   // closed by the program that wrote it
  bool recovered = false;  // what was left of one that wasn't, see session_recovery.h
  std::int64_t dropped_ticks = 0;  // that the recorder couldn't keep up with; 0 if not complete
  std::string end_reason;          // "duration", "signal", a fault's line, ...; empty if killed

  // A value per row of header.trace.rows; row 0 is the first tick.
  std::vector<double> servo_time, step_seconds, force_scale;                        // s, s, 0 to 1
  std::vector<std::int64_t> tick;                                                   // /servo/tick
  std::vector<std::int32_t> missed;                                                 // /servo/missed
  std::vector<std::uint32_t> flags, fault, device_buttons, mirror_buttons;          // bits
  std::vector<Vec3> force_commanded, force_sent, device_position, mirror_position;  // N, mm; D
  std::vector<Quat> device_orientation, mirror_orientation;  // mirror: empty if there is none
};

// Whether it is the recording of a live session. Throws InputError if it can't be read at all.
[[nodiscard]] bool is_session_file(const std::string& path, ReadPolicy policy = ReadPolicy::kTrial);

// Reads a recording, also one that is being written or whose program was killed: rows up to the
// last flush. Throws InputError as read_trace does.
[[nodiscard]] SessionRecording read_session(const std::string& path,
                                            ReadPolicy policy = ReadPolicy::kTrial);

}  // namespace toothprep
