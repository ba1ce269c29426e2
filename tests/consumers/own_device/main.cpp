// own_device TOOTH.vdb SESSION.h5: a haptic device of one's own, and a live session on it: a handle on a motor-driven
// rail, which is where the rail says at each tick.
#include <toothprep/step/bur/bur_library.h>
#include <toothprep/step/core/errors.h>
#include <toothprep/tools/device/servo.h>
#include <toothprep/tools/files/tooth_file.h>
#include <toothprep/tools/live_session/live_session.h>
#include <toothprep/version.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <thread>

using namespace toothprep;

class Rail final : public HapticDevice {
 public:
  explicit Rail(double speed) : speed_(speed) {
    identity_ = {"default", "Rail", "made for a test", "none", "", ""};
    limits_.rate = 1000;
    limits_.max_force = 7.9;
    limits_.max_continuous_force = 1.75;
    limits_.max_stiffness = 1;
    limits_.max_damping = 0.005;
    limits_.workspace = {Vec3(-50, -50, -50), Vec3(50, 50, 50)};
  }
  ~Rail() override { stop(); }

  const DeviceIdentity& identity() const noexcept override { return identity_; }
  const DeviceIdentity* mirror_identity() const noexcept override { return nullptr; }
  const DeviceLimits& limits() const noexcept override { return limits_; }
  Calibration calibration() override { return Calibration::kOk; }
  DeviceStatus status() const noexcept override { return servo_.status(); }

  void start(ServoClient& client) override {
    servo_.open(client);
    leave_ = false;
    thread_ = std::thread([this] { loop(); });
  }
  void stop() noexcept override {
    servo_.ask_to_close();
    if (servo_.in_tick_on_this_thread() || !thread_.joinable()) return;
    while (!servo_.sent_zero()) std::this_thread::yield();
    leave_ = true;
    thread_.join();
    servo_.closed();
  }
  Vec3 last_force() const { return last_force_; }  // after stop(); N

 private:
  void loop() {
    const auto begin = std::chrono::steady_clock::now();
    for (long n = 0; !leave_; ++n) {
      std::this_thread::sleep_until(begin + std::chrono::milliseconds(n));
      DevicePose hand;  // a driver reads it, and sends the force that comes back
      hand.position.x() = 1e-3 * speed_ * static_cast<double>(n);
      last_force_ =
          servo_.begin_tick(1e-3 * static_cast<double>(n), hand, nullptr, DeviceFault::kNone);
      servo_.end_tick();
    }
  }

  const double speed_;  // mm/s
  DeviceIdentity identity_;
  DeviceLimits limits_;
  Servo servo_{7.9, 1e-3, 0.0};  // checks, clamps and ramps the force
  std::atomic<bool> leave_ = false;
  std::thread thread_;
  Vec3 last_force_ = Vec3::Zero();
};

int main(int argc, char** argv) try {
  if (argc != 3) throw Error("usage: own_device TOOTH.vdb SESSION.h5");
  const LayeredTooth tooth = read_tooth(argv[1]);
  Workpiece workpiece(tooth);
  const Bur bur = make_bur("cylinder:D0.8xL1.5", "");
  Rail rail(2);

  LiveSettings settings;
  settings.parameters = preset_parameters("paper");
  settings.registration.fixed_orientation = orientation_of_axis(Vec3::UnitY());
  // From 1.2 mm beside it, 1 mm under its top: the motor starts after half a second in the clear.
  const Box box = bounds_of_solid(tooth);
  settings.start = Vec3(box.min.x() - 1.6, box.max.y() - 1, 0);
  settings.limits.max_force = rail.limits().max_force;
  settings.limits.continuous_force = rail.limits().max_continuous_force;
  settings.watch.duration = 1.2;

  RecordTarget target;
  target.path = argv[2];
  target.header.device_kind = "rail";
  target.header.trace.bur = bur.name();
  target.header.trace.toothprep_version = kVersion;
  const LiveOutcome outcome =
      run_live_session(rail, bur, tooth, workpiece, settings, std::move(target));

  if (outcome.run.end.fault || !outcome.run.failure.empty() || !outcome.totals)
    throw Error(outcome.run.end.reason + outcome.run.failure);
  std::printf("%s after %lld ticks; removed %.4f mm3 of enamel; last force %.3f N\n",
              outcome.run.end.reason.c_str(), static_cast<long long>(outcome.run.ticks.ticks),
              outcome.totals->removed[0], rail.last_force().norm());
} catch (const std::exception& e) {
  std::fprintf(stderr, "%s\n", e.what());
  return 1;
}
