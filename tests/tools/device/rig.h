// A haptic device with a hand on it, whichever back end it is, for tests: what runs it, what
// reaches its motors, and how to break it.
#pragma once

#include <dlfcn.h>

#include <cstdlib>
#include <memory>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "toothprep/proof/libhd_stand_in/stand_in.h"
#include "toothprep/tools/device/hdapi.h"
#include "toothprep/tools/device/openhaptics_device.h"
#include "toothprep/tools/device/simulated_device.h"
#include "toothprep/tools/device/tick_clock.h"

namespace toothprep::testing {

// The stand-in's own functions.
struct StandIn {
  decltype(&standInConfigure) configure;
  decltype(&standInMessage) message;
  decltype(&standInRun) run;
  decltype(&standInState) state_of;
  decltype(&standInMisuses) misuses;
  decltype(&standInFirstMisuse) first_misuse;
  decltype(&standInInject) inject;
  decltype(&standInUnplug) unplug;

  static const StandIn& get() {
    static const StandIn only = [] {
      void* const handle = dlopen(TOOTHPREP_STAND_IN, RTLD_NOW | RTLD_LOCAL);
      if (!handle) throw std::runtime_error(dlerror());
      const auto find = [&](auto& function, const char* name) {
        function = reinterpret_cast<std::decay_t<decltype(function)>>(dlsym(handle, name));
        if (!function) throw std::runtime_error(std::string("no ") + name);
      };
      StandIn s{};
      find(s.configure, "standInConfigure");
      find(s.message, "standInMessage");
      find(s.run, "standInRun");
      find(s.state_of, "standInState");
      find(s.misuses, "standInMisuses");
      find(s.first_misuse, "standInFirstMisuse");
      find(s.inject, "standInInject");
      find(s.unplug, "standInUnplug");
      return s;
    }();
    return only;
  }
  void set_up(const std::string& toml) const {
    if (configure(toml.c_str()) != 0) throw std::runtime_error(message());
  }
  StandInDevice state(unsigned device = 0) const {
    StandInDevice s{};
    if (state_of(device, &s) != 0) throw std::runtime_error("the device was never opened");
    return s;
  }
};

inline Vec3 vec(const double (&v)[3]) { return {v[0], v[1], v[2]}; }

struct RigSettings {
  DevicePose hand;                   // where it rests
  std::optional<DevicePose> mirror;  // with a second device
  double max_force = 7.9;            // N
  double ramp = 0;                   // s
  long missed_every = 0;
};

class Rig {
 public:
  virtual ~Rig() = default;
  HapticDevice& device() { return *device_; }
  void destroy() { device_.reset(); }

  virtual void run(long ticks) = 0;  // or until the servo stops running
  virtual void inject(DeviceFault fault, long ticks) = 0;
  virtual Vec3 motor_force() const = 0;      // N, after a stop or between runs
  virtual Vec3 commanded_force() const = 0;  // N, last sent to the device
  virtual Vec3 true_position() const = 0;    // mm
  virtual bool real_time() const = 0;

 protected:
  // In real time: a machine that stops for seconds is waited for, a servo that doesn't tick is not.
  void wait_for(long ticks) const {
    const DeviceStatus begin = device_->status();
    const double deadline = monotonic_time() + 20;
    for (;;) {
      const DeviceStatus now = device_->status();
      if (now.ticks >= begin.ticks + ticks || now.state != ServoState::kRunning) return;
      if (monotonic_time() > deadline) throw std::runtime_error("the servo does not tick");
      sleep_until(monotonic_time() + 1e-3);
    }
  }
  std::unique_ptr<HapticDevice> device_;
};

class SimulatedRig final : public Rig {
 public:
  SimulatedRig(const RigSettings& s, bool in_real_time) : real_time_(in_real_time) {
    SimulatedSettings settings;
    settings.real_time = in_real_time;
    settings.motion = resting_hand(s.hand);
    if (s.mirror) settings.mirror_motion = resting_hand(*s.mirror);
    settings.phantom.force_limit = s.max_force;
    settings.ramp = s.ramp;
    settings.disturbances.missed_every = s.missed_every;
    auto device = std::make_unique<SimulatedDevice>(settings);
    simulated_ = device.get();
    device_ = std::move(device);
  }
  void run(long ticks) override { real_time_ ? wait_for(ticks) : simulated_->run(ticks); }
  void inject(DeviceFault fault, long ticks) override { simulated_->inject(fault, ticks); }
  Vec3 motor_force() const override { return simulated_->phantom().motor_force(); }
  Vec3 commanded_force() const override { return simulated_->status().force; }
  Vec3 true_position() const override { return simulated_->phantom().true_position(); }
  bool real_time() const override { return real_time_; }

 private:
  bool real_time_;
  SimulatedDevice* simulated_;
};

inline hdapi::HDerror code_of(DeviceFault fault) {
  switch (fault) {
    case DeviceFault::kWarmMotors:
      return hdapi::HD_WARM_MOTORS;
    case DeviceFault::kForceExceeded:
      return hdapi::HD_EXCEEDED_MAX_FORCE;
    case DeviceFault::kImpulseExceeded:
      return hdapi::HD_EXCEEDED_MAX_FORCE_IMPULSE;
    case DeviceFault::kVelocityExceeded:
      return hdapi::HD_EXCEEDED_MAX_VELOCITY;
    case DeviceFault::kCommunication:
      return hdapi::HD_COMM_ERROR;
    case DeviceFault::kTimer:
      return hdapi::HD_TIMER_ERROR;
    case DeviceFault::kDevice:
      return hdapi::HD_DEVICE_FAULT;
    default:
      throw std::runtime_error("the driver has no such error");
  }
}

inline std::string hand_toml(const std::string& table, const DevicePose& pose) {
  std::ostringstream toml;
  toml.precision(17);
  const Vec3& x = pose.position;
  const Quat& q = pose.orientation;
  toml << "[" << table << "]\nmotion = \"rest\"\ncenter_mm = [" << x[0] << ", " << x[1] << ", "
       << x[2] << "]\norientation_xyzw = [" << q.x() << ", " << q.y() << ", " << q.z() << ", "
       << q.w() << "]\nbuttons = " << pose.buttons << "\n";
  return toml.str();
}

class OpenHapticsRig final : public Rig {
 public:
  OpenHapticsRig(const RigSettings& s, bool in_real_time) : real_time_(in_real_time) {
    std::ostringstream toml;
    toml << "stepped = " << (in_real_time ? "false" : "true") << "\nmax_force_n = " << s.max_force
         << "\n[disturbances]\nmissed_every = " << s.missed_every << "\n"
         << hand_toml("hand", s.hand);
    if (s.mirror) toml << hand_toml("mirror", *s.mirror);
    stand_in_.set_up(toml.str());
    OpenHapticsSettings settings;
    settings.library = TOOTHPREP_STAND_IN;
    settings.ramp = s.ramp;
    // In real time the zero comes, however busy the machine; stepped there is no tick to wait for.
    settings.zero_force_wait = in_real_time ? 10 : 0;
    if (s.mirror) settings.mirror_name = "mirror";
    device_ = open_openhaptics(settings);
  }
  void run(long ticks) override { real_time_ ? wait_for(ticks) : void(stand_in_.run(ticks)); }
  void inject(DeviceFault fault, long ticks) override {
    if (fault == DeviceFault::kUnplugged)
      stand_in_.unplug(0);
    else
      stand_in_.inject(0, code_of(fault), ticks);
  }
  Vec3 motor_force() const override { return vec(stand_in_.state().motor_force); }
  Vec3 commanded_force() const override { return vec(stand_in_.state().commanded_force); }
  Vec3 true_position() const override { return vec(stand_in_.state().true_position); }
  bool real_time() const override { return real_time_; }

 private:
  bool real_time_;
  const StandIn& stand_in_ = StandIn::get();
};

// A client that answers with one force, or a given one, and keeps what it was given. Read it only while
// the servo doesn't run.
class Recorder : public ServoClient {
 public:
  explicit Recorder(const Vec3& answer = Vec3::Zero()) : force(answer) { readings.reserve(20000); }
  Vec3 tick(const DeviceReading& reading) override {
    if (readings.size() < readings.capacity()) readings.push_back(reading);
    return force;
  }

  Vec3 force;
  std::vector<DeviceReading> readings;
};

}  // namespace toothprep::testing
