// The simulated Phantom Desktop and a hand that holds it, as a haptic device. In real time it runs
// at the model's rate on a thread of its own; otherwise run() computes ticks on the caller's thread
// as fast as it can, on a clock of its own, with the same bits every time.
//
// In real time a tick that can't start before the next one is due is left out, as a driver would,
// and counted: the motors held their force meanwhile.
#pragma once

#include <atomic>
#include <optional>
#include <thread>

#include "toothprep/tools/device/servo.h"
#include "toothprep/tools/device/simulated_arm.h"

namespace toothprep {

struct SimulatedSettings {                        // checked by SimulatedDevice's constructor
  PhantomModel phantom;                           // mass, friction, encoders, motors
  HandModel hand;                                 // the spring and damper of the fingers
  HandMotion motion = gentle_hand(DevicePose());  // where the hand wants to be
  std::optional<HandMotion> mirror_motion;  // a second device of the same model, without force
  Disturbances disturbances;                // ticks left out, noise, faults
  bool real_time = true;                    // false: run() computes the ticks
  double ramp = 0.25;                       // s, of the force after a start or a fault; 0: none
  double continuous_force = 1.75;           // N, for the limits; the Desktop's as usually quoted
};

class SimulatedDevice final : public HapticDevice {  // haptic_device.h
 public:
  // Throws Error that names the first violated condition.
  explicit SimulatedDevice(const SimulatedSettings& settings);
  ~SimulatedDevice() override;

  const DeviceIdentity& identity() const noexcept override { return identity_; }
  const DeviceIdentity* mirror_identity() const noexcept override {
    return mirror_ ? &mirror_identity_ : nullptr;
  }
  const DeviceLimits& limits() const noexcept override { return limits_; }
  Calibration calibration() override { return Calibration::kOk; }
  void start(ServoClient& client) override;
  void stop() noexcept override;
  void zero_force_soon() noexcept override { servo_.ask_to_close(); }
  DeviceStatus status() const noexcept override { return servo_.status(); }

  // Without real time, between start() and stop(): this many ticks (of the clock: those that the
  // disturbances leave out count too). Throws Error otherwise.
  void run(long ticks);

  // The driver reports `fault` for the next `ticks` ticks. From any thread; one at a time.
  void inject(DeviceFault fault, long ticks = 1) noexcept;

  // The arm itself; while the servo runs in real time, of the servo's thread only.
  const SimulatedPhantom& phantom() const noexcept { return arm_.phantom(); }

 private:
  void run_in_real_time() noexcept;
  void tick(double time) noexcept;       // a reading, the client, the force
  void move_arms(long passed) noexcept;  // after a tick
  void hold_for_a_tick() noexcept;       // the arms move under the held force
  double arm_time() const noexcept { return static_cast<double>(clock_tick_) * period_; }

  double period_;
  bool real_time_;
  SimulatedArm arm_;
  std::optional<SimulatedArm> mirror_;
  DeviceIdentity identity_, mirror_identity_;
  DeviceLimits limits_;
  Servo servo_;
  Vec3 held_force_ = Vec3::Zero(), new_force_ = Vec3::Zero();
  long clock_tick_ = 0;  // of the arms, never reset: a restart goes on where they are
  long first_tick_ = 0;  // clock_tick_ at the start
  bool started_ = false;
  std::atomic<bool> leave_ = false;
  std::atomic<DeviceFault> injected_ = DeviceFault::kNone;
  std::atomic<long> injected_ticks_ = 0;
  std::thread thread_;
};

}  // namespace toothprep
