// A device written against the public headers alone, as CONTRIBUTING.md describes it, and a live
// session on it: a handle on a motor-driven rail, which is where the rail says at each tick.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <thread>
#include <vector>

#include "toothprep/proof/specimen/block.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/session/session.h"
#include "toothprep/tools/device/servo.h"
#include "toothprep/tools/live/live_watch.h"

namespace toothprep {
namespace {

class Rail final : public HapticDevice {
 public:
  explicit Rail(double speed) : speed_(speed) {
    identity_ = {"default", "Rail", "made for a test", "none", "", ""};
    limits_.rate = kRate;
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

  // After stop(): every force that went to the motors, N, frame D.
  const std::vector<Vec3>& sent() const { return sent_; }

 private:
  static constexpr double kRate = 1000;

  void loop() {
    const auto begin = std::chrono::steady_clock::now();
    for (long n = 0; !leave_; ++n) {
      std::this_thread::sleep_until(begin + std::chrono::milliseconds(n));
      const double time = static_cast<double>(n) / kRate;
      DevicePose hand;
      hand.position.x() = speed_ * time;
      // The motor waits until the pedal was released, and the session may begin late.
      hand.buttons = n % 100 < 20 ? 0 : 1;
      sent_.push_back(servo_.begin_tick(time, hand, nullptr, DeviceFault::kNone));
      servo_.end_tick();
    }
  }

  double speed_;
  DeviceIdentity identity_;
  DeviceLimits limits_;
  Servo servo_{7.9, 1 / kRate, 0.0};
  std::atomic<bool> leave_ = false;
  std::thread thread_;
  std::vector<Vec3> sent_;
};

TEST(DeviceFromOutside, ALiveSessionGrindsOnItAndEndsWithZeroForce) {
  BlockOptions options;
  options.size = Vec3(4, 2, 3);
  options.enamel = 2;
  const LayeredTooth tooth = make_block(options);
  Workpiece workpiece(tooth);
  const Bur bur = make_bur("cylinder:D0.8xL1.5", "");
  const Parameters parameters = preset_parameters("paper");

  // From 0.2 mm beside the block's side at x = -2 into it, the axis upright, 1 mm deep.
  const Vec3 start(-2.6, -1, 0);
  Registration registration;
  registration.fixed_orientation = orientation_of_axis(Vec3::UnitY());
  ForceLimits limits;
  limits.max_force = 7.9;
  limits.continuous_force = 1.75;
  LiveLoop loop(limits, {1, 0}, nullptr);
  LiveWatch watch;
  watch.duration = 0.6;
  std::unique_ptr<Session> session;
  Rail rail(5.0);
  const LiveEnd end = run_live(
      rail, loop, registration, start, parameters.time_step,
      [&](const Pose& pose) -> Session* {
        HandleSample first;
        first.pose = pose;
        session = std::make_unique<Session>(bur, workpiece, parameters, Drive::kCoupled, first);
        return session.get();
      },
      watch);

  EXPECT_FALSE(end.fault) << end.reason;
  EXPECT_EQ(end.reason, "duration");
  ASSERT_TRUE(session);
  EXPECT_GT(session->totals().removed[0], 0);
  double most_against = 0;
  for (const Vec3& force : rail.sent()) most_against = std::max(most_against, -force.x());
  EXPECT_GT(most_against, 0.1);  // the spring of 1 N/mm, stretched by more than 0.1 mm
  EXPECT_EQ(rail.sent().back(), Vec3::Zero());
  EXPECT_EQ(rail.status().state, ServoState::kStopped);
}

}  // namespace
}  // namespace toothprep
