// Recordings made in memory, with everything in them known.
#pragma once

#include <cmath>
#include <functional>
#include <random>
#include <string>

#include "toothprep/step/core/live_tick.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/tools/device/simulated_device.h"
#include "toothprep/tools/files/session_file.h"

namespace toothprep::testing {

inline constexpr double kPeriod = 1e-3;  // s

inline SessionHeader made_header(const std::string& protocol = {}) {
  SessionHeader h;
  h.trace.parameters_toml = to_toml(preset_parameters("paper"));
  h.trace.drive = "coupled";
  h.trace.toothprep_version = "test";
  h.device_kind = "simulated";
  h.device_model = "simulated Phantom Desktop";
  h.rate_hz = 1 / kPeriod;
  h.max_force_n = 7.9;
  h.max_continuous_force_n = 1.75;
  h.max_stiffness_n_per_mm = 1.0;
  h.protocol = protocol;
  return h;
}

inline void append(SessionRecording& r, const LiveTick& t) {
  r.header.trace.rows.push_back(t.row);
  r.servo_time.push_back(t.servo_time);
  r.step_seconds.push_back(t.step_seconds);
  r.force_scale.push_back(t.force_scale);
  r.tick.push_back(t.tick);
  r.missed.push_back(t.missed);
  r.flags.push_back(t.flags);
  r.fault.push_back(t.fault);
  r.device_buttons.push_back(t.device_buttons);
  r.force_commanded.push_back(t.commanded_force);
  r.force_sent.push_back(t.sent_force);
  r.device_position.push_back(t.device_position);
  r.device_orientation.push_back(t.device_orientation);
}

// `n` ticks exactly at n T, at rest at the origin, without force; 20 us of work each.
inline SessionRecording made_recording(std::size_t n, const std::string& protocol = {}) {
  SessionRecording r;
  r.header = made_header(protocol);
  r.complete = true;
  r.end_reason = "duration";
  for (std::size_t i = 0; i < n; ++i) {
    LiveTick t;
    t.tick = static_cast<std::int64_t>(i);
    t.servo_time = static_cast<double>(i) * kPeriod;
    t.row.handle.time = t.servo_time;
    t.force_scale = 1;
    t.step_seconds = 20e-6;
    append(r, t);
  }
  return r;
}

// Leaves out row i; the device's count goes on if it was the recorder that lost it.
inline void erase_row(SessionRecording& r, std::size_t i) {
  const auto at = static_cast<std::ptrdiff_t>(i);
  r.header.trace.rows.erase(r.header.trace.rows.begin() + at);
  const auto erase = [&](auto&... columns) { (columns.erase(columns.begin() + at), ...); };
  erase(r.servo_time, r.step_seconds, r.force_scale, r.tick, r.missed, r.flags, r.fault,
        r.device_buttons, r.force_commanded, r.force_sent, r.device_position, r.device_orientation);
}

// A law from place to force on a simulated device, as an active check runs it, recorded.
class ProbeClient final : public ServoClient {
 public:
  // Time of the rows (s), place and its step since the last tick (mm) to a force (N), frame D.
  using Law = std::function<Vec3(double, const Vec3&, const Vec3&)>;
  ProbeClient(const SessionHeader& header, Law law) : law_(std::move(law)) {
    recording.header = header;
    recording.complete = true;
  }
  Vec3 tick(const DeviceReading& reading) override {
    LiveTick t;
    const Vec3& place = reading.hand.position;
    if (count_ == 0) last_ = place;
    t.tick = reading.tick;
    t.servo_time = reading.time;
    t.missed = reading.missed;
    t.device_position = place;
    t.device_orientation = reading.hand.orientation;
    t.sent_force = reading.previous_force;
    t.force_scale = reading.force_scale;
    t.fault = static_cast<std::uint32_t>(reading.fault);
    t.step_seconds = 10e-6;
    t.row.handle.time = static_cast<double>(count_++) * kPeriod;
    t.row.handle.pose.position = t.row.bur.position = place;
    t.commanded_force = law_(t.row.handle.time, place, place - last_);
    if (t.commanded_force.norm() > 7.9) {
      t.commanded_force *= 7.9 / t.commanded_force.norm();
      t.flags |= kForceClamped;
    }
    if (t.force_scale < 1) t.flags |= kForceRamped;
    last_ = place;
    append(recording, t);
    return t.commanded_force;
  }
  SessionRecording recording;

 private:
  Law law_;
  Vec3 last_ = Vec3::Zero();
  long count_ = 0;
};

inline SessionRecording run_probe(const SimulatedSettings& settings, const SessionHeader& header,
                                  ProbeClient::Law law, double seconds) {
  SimulatedDevice device(settings);
  ProbeClient client(header, std::move(law));
  device.start(client);
  device.run(std::lround(seconds / kPeriod));
  device.stop();
  return std::move(client.recording);
}

}  // namespace toothprep::testing
