// A live session: what the tick does with hand, buttons and faults, and how it ends.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cstring>
#include <thread>

#include "live_experiment.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/live/live_watch.h"

namespace toothprep::testing {
namespace {

using ::testing::HasSubstr;

struct Lived {
  Rows rows;
  LiveStatus status;
  SessionTotals totals;
};

// `ticks` of a session in virtual time.
Lived run_virtual(SimulatedSettings settings, const LayeredTooth& tooth, Drive drive, long ticks,
                  const ForceLimits& limits, const LiveButtons& buttons = {},
                  const std::optional<Vec3>& start = {}) {
  settings.real_time = false;
  SimulatedDevice device(settings);
  Lived run;
  LiveLoop loop(limits, buttons, &run.rows);
  device.start(loop);
  device.run(1);
  const DevicePose first = *loop.waiting_pose();
  const Registration registration = start ? Registration() : same_frame();
  const HandleFrame frame(registration, first.position, Vec3::Zero());
  const Bur bur = paper_cylinder();
  Workpiece workpiece(tooth);
  const Parameters parameters = preset_parameters("paper");
  HandleSample at;
  at.pose = frame.to_world(first.position, first.orientation);
  if (start) at.pose.position = *start;
  Session session(bur, workpiece, parameters, drive, at);
  loop.begin(session, frame, registration, start, parameters.time_step);
  device.run(ticks);
  device.stop();
  loop.finish();
  run.status = loop.status();
  run.totals = session.totals();
  return run;
}

SimulatedSettings grinding_hand(double speed = 2, double seconds = 4) {
  SimulatedSettings settings;
  settings.motion = hand_along(slot(speed, seconds));
  return settings;
}

bool same_bits(const Vec3& a, const Vec3& b) { return std::memcmp(&a, &b, sizeof a) == 0; }

TEST(LiveLoop, WhatItRecordsIsReplayedBitForBit) {
  const LayeredTooth tooth = enamel_block();
  Lived run = run_virtual(grinding_hand(), tooth, Drive::kCoupled, 3000, no_watch());
  ASSERT_EQ(run.rows.ticks.size(), 3000u);
  EXPECT_GT(run.totals.removed[0], 0.3);
  std::vector<HandleSample> path;
  for (const LiveTick& tick : run.rows.ticks) path.push_back(tick.row.handle);
  const Bur bur = paper_cylinder();
  Workpiece workpiece(tooth);
  const ReplayResult again =
      replay(bur, workpiece, preset_parameters("paper"), Drive::kCoupled, path);
  for (std::size_t n = 0; n < path.size(); ++n) {
    const StepRecord &a = run.rows.ticks[n].row, &b = again.rows[n];
    ASSERT_TRUE(same_bits(a.bur.position, b.bur.position)) << n;
    ASSERT_TRUE(same_bits(a.device_force, b.device_force)) << n;
    ASSERT_EQ(a.torque, b.torque) << n;
    ASSERT_EQ(a.removed_volume, b.removed_volume) << n;
  }
}

TEST(LiveLoop, TheForceThatTheDeviceSendsIsTheSessionsTurnedIntoItsFrame) {
  Lived run = run_virtual(grinding_hand(), enamel_block(), Drive::kCoupled, 3000, no_watch());
  double most = 0;
  for (std::size_t n = 1000; n + 1 < run.rows.ticks.size(); ++n) {  // both ramps are over
    const LiveTick& tick = run.rows.ticks[n];
    EXPECT_EQ(tick.flags, 0u);
    EXPECT_EQ(tick.commanded_force, tick.row.device_force);
    EXPECT_EQ(run.rows.ticks[n + 1].sent_force, tick.commanded_force);
    most = std::max(most, tick.commanded_force.norm());
  }
  EXPECT_GT(most, 0.3);
}

TEST(LiveLoop, StartsWhereItIsToldWhereverTheHandIs) {
  SimulatedSettings settings;
  DevicePose far;
  far.position = Vec3(40, -30, 12);
  settings.motion = resting_hand(far);
  const Vec3 start(0, 3, 0);
  Lived run = run_virtual(settings, enamel_block(), Drive::kCoupled, 50, no_watch(), {}, start);
  for (const LiveTick& tick : run.rows.ticks)
    EXPECT_LT((tick.row.handle.pose.position - start).norm(), 0.03);  // an encoder count
  EXPECT_EQ(run.rows.ticks.front().row.handle.pose.position, start);
}

TEST(LiveLoop, TheBurRunsWhileThePedalIsHeldAndTheHandleRestsWhileTheClutchIs) {
  SimulatedSettings settings;
  auto path = slot(2, 1);
  for (auto& sample : path)  // button 1 from 0.2 s, button 2 from 0.5 to 0.7 s
    sample.buttons =
        (sample.time >= 0.2 ? 1u : 0u) | (sample.time >= 0.5 && sample.time < 0.7 ? 2u : 0u);
  settings.motion = hand_along(path);
  Lived run = run_virtual(settings, enamel_block(), Drive::kCoupled, 900, no_watch(), {1, 2});
  const auto& ticks = run.rows.ticks;
  EXPECT_EQ(ticks[100].row.handle.buttons, 0u);
  EXPECT_EQ(ticks[100].row.rotation_rate, 0);
  EXPECT_EQ(ticks[300].row.handle.buttons, kPedalButton);
  EXPECT_GT(ticks[300].row.rotation_rate, 0);
  EXPECT_TRUE(same_bits(ticks[510].row.handle.pose.position, ticks[690].row.handle.pose.position));
  EXPECT_TRUE(ticks[600].flags & kHandleHeld);
  for (std::size_t n = 1; n < ticks.size(); ++n)  // no jump on holding nor on release
    EXPECT_LT((ticks[n].row.handle.pose.position - ticks[n - 1].row.handle.pose.position).norm(),
              0.08);
}

TEST(LiveLoop, DirectRenderingInEnamelGoesUnstableAndTheGovernorStopsItTheCouplingStaysQuiet) {
  ForceLimits limits = no_watch();
  limits.ramp = 0;
  const Lived direct = run_virtual(grinding_hand(), enamel_block(), Drive::kDirect, 4000, limits);
  EXPECT_TRUE(direct.status.vibrates);
  EXPECT_EQ(direct.rows.ticks.back().commanded_force, Vec3::Zero());
  const Lived coupled = run_virtual(grinding_hand(), enamel_block(), Drive::kCoupled, 4000, limits);
  EXPECT_FALSE(coupled.status.vibrates);
  EXPECT_GT(coupled.totals.removed[0], 0.5);
}

// ---- In real time, with the main thread's part.

class Live : public ::testing::Test {
 protected:
  LiveEnd run(SimulatedSettings settings, LiveWatch watch,
              const std::function<void(SimulatedDevice&, const LiveLoop&)>& meanwhile = {}) {
    device_ = std::make_unique<SimulatedDevice>(settings);
    LiveLoop loop(no_watch(), {}, &rows_);
    std::thread other;
    if (meanwhile) other = std::thread([&] { meanwhile(*device_, loop); });
    struct Join {
      std::thread& thread;
      ~Join() {
        if (thread.joinable()) thread.join();
      }
    } join{other};
    const LiveEnd end = run_live(
        *device_, loop, same_frame(), {}, parameters_.time_step,
        [&](const Pose& pose) -> Session* {
          HandleSample first;
          first.pose = pose;
          session_ =
              std::make_unique<Session>(bur_, workpiece_, parameters_, Drive::kCoupled, first);
          return session_.get();
        },
        watch);
    return end;
  }

  // Ticks before the session begins, however many a busy machine takes, aren't steps.
  static void wait_for_steps(const LiveLoop& loop, std::int64_t steps) {
    for (int tries = 0; loop.status().steps < steps && tries < 1000; ++tries)
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }

  Parameters parameters_ = preset_parameters("paper");
  Bur bur_ = paper_cylinder();
  LayeredTooth tooth_ = enamel_block();
  Workpiece workpiece_{tooth_};
  std::unique_ptr<Session> session_;
  std::unique_ptr<SimulatedDevice> device_;
  Rows rows_;
};

TEST_F(Live, EndsAfterItsDurationWithZeroForceAndEveryTickHandedOn) {
  LiveWatch watch;
  watch.duration = 0.3;
  int reports = 0;
  watch.report = [&](const LiveStatus&, const DeviceStatus&) { ++reports; };
  const LiveEnd end = run(grinding_hand(), watch);
  EXPECT_FALSE(end.fault);
  EXPECT_EQ(end.reason, "duration");
  EXPECT_GE(reports, 1);
  EXPECT_GT(rows_.ticks.size(), 50u);
  for (std::size_t n = 0; n < rows_.ticks.size(); ++n)
    EXPECT_EQ(rows_.ticks[n].row.handle.time, static_cast<double>(n) * 1e-3);
  EXPECT_EQ(device_->status().state, ServoState::kStopped);
  EXPECT_EQ(device_->status().force, Vec3::Zero());
}

TEST_F(Live, EndsWhenItIsAskedTo) {
  LiveWatch watch;
  std::atomic<bool> asked = false;
  watch.stop_asked = [&] { return asked.load(); };
  const LiveEnd end = run(grinding_hand(), watch, [&](SimulatedDevice&, const LiveLoop&) {
    std::this_thread::sleep_for(std::chrono::milliseconds(150));
    asked = true;
  });
  EXPECT_FALSE(end.fault);
  EXPECT_EQ(end.reason, "asked to stop");
  EXPECT_EQ(device_->status().force, Vec3::Zero());
}

TEST_F(Live, AFinalFaultEndsItWithTheFaultsLineAndZeroForce) {
  LiveWatch watch;
  watch.duration = 5;
  const LiveEnd end =
      run(grinding_hand(), watch, [](SimulatedDevice& device, const LiveLoop& loop) {
        wait_for_steps(loop, 50);
        device.inject(DeviceFault::kUnplugged);
      });
  EXPECT_TRUE(end.fault);
  EXPECT_EQ(end.reason, describe(DeviceFault::kUnplugged));
  EXPECT_EQ(device_->status().force, Vec3::Zero());
  EXPECT_FALSE(rows_.ticks.empty());
}

TEST_F(Live, ATransientFaultWithholdsTheForceAndTheSessionGoesOn) {
  LiveWatch watch;
  watch.duration = 1.5;
  const LiveEnd end =
      run(grinding_hand(), watch, [](SimulatedDevice& device, const LiveLoop& loop) {
        wait_for_steps(loop, 50);
        device.inject(DeviceFault::kWarmMotors, 20);
      });
  EXPECT_FALSE(end.fault);
  int withheld = 0;
  for (const LiveTick& tick : rows_.ticks)
    if (tick.fault == static_cast<std::uint32_t>(DeviceFault::kWarmMotors)) {
      ++withheld;
      EXPECT_TRUE(tick.flags & kForceWithheld);
      EXPECT_EQ(tick.commanded_force, Vec3::Zero());
    }
  EXPECT_EQ(withheld, 20);
}

TEST_F(Live, AnExceptionOnTheMainThreadLeavesZeroForceToo) {
  device_ = std::make_unique<SimulatedDevice>(grinding_hand());
  LiveLoop loop(no_watch(), {}, nullptr);
  EXPECT_THROW(
      static_cast<void>(run_live(*device_, loop, same_frame(), {}, 1e-3,
                                 [](const Pose&) -> Session* { throw Error("no session"); }, {})),
      Error);
  EXPECT_EQ(device_->status().state, ServoState::kStopped);
  EXPECT_EQ(device_->status().force, Vec3::Zero());
}

TEST_F(Live, AServoThatHangsIsNoticed) {
  SimulatedSettings settings = grinding_hand();
  settings.disturbances.late_every = 200;
  settings.disturbances.late = 0.4;
  LiveWatch watch;
  watch.duration = 5;
  const LiveEnd end = run(settings, watch);
  EXPECT_TRUE(end.fault);
  EXPECT_THAT(end.reason, HasSubstr("no tick came for"));
}

}  // namespace
}  // namespace toothprep::testing
