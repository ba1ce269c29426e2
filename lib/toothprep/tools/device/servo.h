// What stands between a client and the motors, the same for every device:
//
//   reading -> finite? -> fault? -> client -> finite? -> clamp to F_max -> times ramp s -> motors
//
//   s = 0 in a tick with a fault and from the moment that a close is asked for; otherwise it grows
//   by T/t_ramp per tick up to 1, from 0 at the start.
//
//   symbol   here        unit
//   F_max    max_force   N, the norm; the direction is kept
//   T        period      s
//   t_ramp   ramp        s; 0: the first tick without a fault has s = 1
#pragma once

#include <atomic>
#include <cstdint>

#include "toothprep/tools/device/haptic_device.h"

namespace toothprep {

class Servo {  // one per device; a back end owns it
 public:
  // Throws Error unless max_force and period are finite and > 0 and ramp is finite and >= 0.
  Servo(double max_force, double period, double ramp);

  // Before the first tick; resets the status.
  void open(ServoClient& client) noexcept;

  // On the servo's thread: begin, then end once the force that it returns (N, frame D) was sent.
  // `mirror` may be nullptr. `fault`: what the driver reported for this tick.
  Vec3 begin_tick(double time, const DevicePose& hand, const DevicePose* mirror,
                  DeviceFault fault) noexcept;
  void end_tick() noexcept;

  // A fault found outside begin_tick. It is reported at once and acts on the next tick.
  void report(DeviceFault fault) noexcept;
  void note_driver_code(std::uint32_t code) noexcept { driver_code_ = code; }

  // From any thread: zero force from the next tick on; and whether that tick has been sent.
  void ask_to_close() noexcept { closing_ = true; }
  bool sent_zero() const noexcept { return sent_zero_; }
  // Once there are no more ticks and the motors are off.
  void closed() noexcept;
  // For good, when the driver was given up: the client isn't called any more, and when this returns
  // no call of it goes on (or it has gone on for `longest` s).
  void abandon(double longest) noexcept;

  bool running() const noexcept { return state_ == ServoState::kRunning; }  // after open()
  // Whether a ramp begins with this tick, so that the driver can be made to allow forces again.
  bool recovering() const noexcept { return recovering_; }
  [[nodiscard]] bool in_tick_on_this_thread() const noexcept;
  [[nodiscard]] DeviceStatus status() const noexcept;

 private:
  Vec3 client_force(const DeviceReading& reading, DeviceFault& fault) noexcept;
  void record(DeviceFault fault) noexcept;

  const double max_force_, period_, scale_step_;

  // The servo thread's own.
  ServoClient* client_ = nullptr;
  double scale_ = 0, last_time_ = 0;
  std::int64_t tick_ = 0;
  bool any_reading_ = false, recovering_ = false, closing_in_this_tick_ = false;
  DevicePose last_hand_, last_mirror_;
  Vec3 last_force_ = Vec3::Zero();
  DeviceFault pending_ = DeviceFault::kNone, current_ = DeviceFault::kNone;

  // Read by other threads.
  std::atomic<ServoState> state_ = ServoState::kIdle;
  std::atomic<bool> closing_ = false, sent_zero_ = false, abandoned_ = false, in_client_ = false;
  std::atomic<std::int64_t> ticks_ = 0, faults_ = 0, clamped_ = 0, missed_ = 0;
  std::atomic<double> time_ = 0, ended_ = 0, force_x_ = 0, force_y_ = 0, force_z_ = 0;
  std::atomic<DeviceFault> last_fault_ = DeviceFault::kNone;
  std::atomic<std::uint32_t> driver_code_ = 0;
};

}  // namespace toothprep
