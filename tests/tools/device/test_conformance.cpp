// What every haptic device does, on every back end: the simulated one, and OpenHaptics' interface
// on the stand-in; stepped (exact) and in real time. Counts and order are checked, never how long
// something took: the machine may be busy.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "rig.h"
#include "toothprep/step/core/errors.h"

namespace toothprep::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

struct Kind {
  const char* name;
  bool openhaptics, real_time;
};
std::ostream& operator<<(std::ostream& out, const Kind& kind) { return out << kind.name; }

class Conformance : public ::testing::TestWithParam<Kind> {
 protected:
  std::unique_ptr<Rig> rig(const RigSettings& settings = {}) const {
    if (GetParam().openhaptics)
      return std::make_unique<OpenHapticsRig>(settings, GetParam().real_time);
    return std::make_unique<SimulatedRig>(settings, GetParam().real_time);
  }
  void TearDown() override {
    if (GetParam().openhaptics) {
      EXPECT_EQ(StandIn::get().misuses(), 0) << StandIn::get().first_misuse();
    }
  }
};

TEST_P(Conformance, TicksComeOneByOneAtIncreasingTimes) {
  const auto r = rig();
  Recorder client;
  EXPECT_DOUBLE_EQ(r->device().limits().rate, 1000);
  EXPECT_EQ(r->device().status().state, ServoState::kIdle);
  r->device().start(client);
  EXPECT_EQ(r->device().status().state, ServoState::kRunning);
  r->run(100);
  r->device().stop();
  EXPECT_EQ(r->device().status().state, ServoState::kStopped);
  ASSERT_GE(client.readings.size(), 100u);
  if (!r->real_time()) {
    EXPECT_EQ(client.readings.size(), 100u);
  }
  for (std::size_t i = 0; i < client.readings.size(); ++i) {
    const DeviceReading& reading = client.readings[i];
    EXPECT_EQ(reading.tick, static_cast<std::int64_t>(i));
    if (i > 0) {
      EXPECT_GT(reading.time, client.readings[i - 1].time);
    }
    EXPECT_EQ(reading.fault, DeviceFault::kNone);
  }
  EXPECT_EQ(r->device().status().ticks, static_cast<std::int64_t>(client.readings.size()));
  EXPECT_EQ(r->device().status().faults, 0);
}

TEST_P(Conformance, PoseAndButtonsArriveInTheDeviceFrame) {
  RigSettings s;
  s.hand.position = Vec3(10, -20, 30);
  // The stylus' z points to the device's x: a rotation that a transposed or shifted matrix betrays.
  s.hand.orientation = Quat(Eigen::AngleAxisd(units::kPi / 2, Vec3::UnitY()));
  s.hand.buttons = 5;
  const auto r = rig(s);
  Recorder client;
  r->device().start(client);
  r->run(20);
  r->device().stop();
  EXPECT_TRUE(r->device().limits().has_orientation);
  EXPECT_TRUE(r->device().limits().workspace.contains(s.hand.position));
  for (const DeviceReading& reading : client.readings) {
    // Nobody pushes: the handle rests where the hand is, read in counts of 0.023 mm.
    EXPECT_LT((reading.hand.position - s.hand.position).cwiseAbs().maxCoeff(), 0.0116);
    EXPECT_LT((reading.hand.orientation * Vec3::UnitZ() - Vec3::UnitX()).norm(), 1e-12);
    EXPECT_EQ(reading.hand.buttons, 5u);
    EXPECT_FALSE(reading.mirror.has_value());
  }
}

TEST_P(Conformance, ForceArrivesAtTheMotorsAndMovesTheHand) {
  const auto r = rig();
  Recorder client(Vec3(0.5, -0.25, 1));
  r->device().start(client);
  r->run(300);
  if (!r->real_time()) {
    EXPECT_EQ(r->motor_force(), client.force);
  }
  r->device().stop();
  // The hand's spring of 0.3 N/mm balances the force, give or take the friction of 0.06 N.
  const Vec3 expected = client.force / 0.3;
  const Vec3 last = client.readings.back().hand.position;
  EXPECT_LT((last - expected).cwiseAbs().maxCoeff(), 0.06 / 0.3 + 0.05);
  for (std::size_t i = 1; i < client.readings.size(); ++i)
    EXPECT_EQ(client.readings[i].previous_force, client.force);
}

TEST_P(Conformance, ForceAboveTheLimitKeepsItsDirection) {
  RigSettings s;
  s.max_force = 2.5;
  const auto r = rig(s);
  EXPECT_DOUBLE_EQ(r->device().limits().max_force, 2.5);
  EXPECT_LE(r->device().limits().max_continuous_force, 2.5);
  Recorder client(Vec3(30, 0, -40));
  r->device().start(client);
  r->run(10);
  r->device().stop();
  for (std::size_t i = 1; i < client.readings.size(); ++i)
    EXPECT_LT((client.readings[i].previous_force - Vec3(1.5, 0, -2)).norm(), 1e-12);
  EXPECT_EQ(r->device().status().clamped_ticks, r->device().status().ticks);
}

TEST_P(Conformance, StopLeavesZeroForceAndNoMoreTicks) {
  const auto r = rig();
  Recorder client(Vec3(1, 2, 3));
  r->device().stop();  // before any start: nothing
  r->device().start(client);
  r->run(20);
  r->device().stop();
  const std::size_t ticks = client.readings.size();
  EXPECT_EQ(r->motor_force(), Vec3::Zero());
  // A stepped device gets no further tick for a zero force: its forces are switched off instead.
  if (r->real_time()) {
    EXPECT_EQ(r->commanded_force(), Vec3::Zero());
  }
  r->device().stop();
  sleep_until(monotonic_time() + 0.02);
  EXPECT_EQ(client.readings.size(), ticks);
  EXPECT_EQ(r->motor_force(), Vec3::Zero());
}

TEST_P(Conformance, LeavingByAnExceptionLeavesZeroForce) {
  auto r = rig();
  Recorder client(Vec3(1, 2, 3));
  try {
    r->device().start(client);
    r->run(20);
    throw std::runtime_error("something else went wrong");
  } catch (const std::runtime_error&) {
    r->destroy();
  }
  const std::size_t ticks = client.readings.size();
  sleep_until(monotonic_time() + 0.02);
  EXPECT_EQ(client.readings.size(), ticks);
  if (GetParam().openhaptics) {
    EXPECT_EQ(r->motor_force(), Vec3::Zero());
    EXPECT_EQ(StandIn::get().state().force_output, 0);
    if (r->real_time()) {
      EXPECT_EQ(r->commanded_force(), Vec3::Zero());
    }
  }
}

TEST_P(Conformance, StartsAgainAfterStop) {
  const auto r = rig();
  Recorder first(Vec3(1, 0, 0)), second(Vec3(0, 1, 0));
  r->device().start(first);
  r->run(20);
  EXPECT_THAT([&] { r->device().start(second); }, ThrowsMessage<Error>(HasSubstr("runs already")));
  r->device().stop();
  const std::size_t ticks = first.readings.size();
  r->device().start(second);
  r->run(20);
  if (!r->real_time()) {
    EXPECT_EQ(r->motor_force(), second.force);
  }
  r->device().stop();
  EXPECT_EQ(first.readings.size(), ticks);
  ASSERT_GE(second.readings.size(), 20u);
  EXPECT_EQ(second.readings.front().tick, 0);
  EXPECT_EQ(second.readings.front().previous_force, Vec3::Zero());
  EXPECT_LT(second.readings.front().time, 5.0);
}

TEST_P(Conformance, TransientFaultsGiveZeroForceWhileTheyLast) {
  for (const DeviceFault fault : {DeviceFault::kWarmMotors, DeviceFault::kForceExceeded,
                                  DeviceFault::kImpulseExceeded, DeviceFault::kVelocityExceeded}) {
    SCOPED_TRACE(describe(fault));
    const auto r = rig();
    Recorder client(Vec3(1, 0, 0));
    r->device().start(client);
    r->run(10);
    r->inject(fault, 5);
    r->run(30);
    if (!r->real_time()) {  // it is back
      EXPECT_EQ(r->motor_force(), client.force);
    }
    r->device().stop();
    const DeviceStatus status = r->device().status();
    EXPECT_EQ(status.last_fault, fault);
    EXPECT_EQ(status.faults, 1);
    int faulty = 0;
    for (std::size_t i = 0; i + 1 < client.readings.size(); ++i) {
      const bool is_faulty = client.readings[i].fault != DeviceFault::kNone;
      if (is_faulty) {
        EXPECT_EQ(client.readings[i].fault, fault);
      }
      faulty += is_faulty;
      EXPECT_EQ(client.readings[i + 1].previous_force, is_faulty ? Vec3(0, 0, 0) : client.force);
    }
    EXPECT_EQ(faulty, 5);
  }
}

TEST_P(Conformance, AfterAFaultTheForceIsRampedUpAgain) {
  RigSettings s;
  s.ramp = 0.01;  // ten ticks
  const auto r = rig(s);
  Recorder client(Vec3(1, 0, 0));
  r->device().start(client);
  r->run(30);
  r->inject(DeviceFault::kVelocityExceeded, 1);
  r->run(30);
  r->device().stop();
  // Ticks since the start or the fault, k = 1, 2, ...: scale k/10 up to 1.
  double expected = 0;
  int dips = 0;
  for (const DeviceReading& reading : client.readings) {
    const bool faulty = reading.fault != DeviceFault::kNone;
    dips += faulty;
    expected = faulty ? 0 : std::min(1.0, expected + 0.1);
    EXPECT_NEAR(reading.force_scale, expected, 1e-12);
  }
  EXPECT_EQ(dips, 1);
  for (std::size_t i = 1; i < client.readings.size(); ++i)
    EXPECT_EQ(client.readings[i].previous_force.x(), client.readings[i - 1].force_scale);
}

TEST_P(Conformance, FinalFaultsStopTheClientAtZeroForce) {
  for (const DeviceFault fault : {DeviceFault::kCommunication, DeviceFault::kTimer,
                                  DeviceFault::kDevice, DeviceFault::kUnplugged}) {
    SCOPED_TRACE(describe(fault));
    const auto r = rig();
    Recorder client(Vec3(1, 0, 0));
    r->device().start(client);
    r->run(10);
    r->inject(fault, 1);
    r->run(30);
    if (r->real_time()) {  // run() came back at the fault; the tick of the fault itself has to end
      const double deadline = monotonic_time() + 5;
      while (r->device().status().state == ServoState::kRunning && monotonic_time() < deadline)
        sleep_until(monotonic_time() + 1e-3);
    }
    const DeviceStatus status = r->device().status();
    EXPECT_EQ(status.state, ServoState::kFaulted);
    EXPECT_EQ(status.last_fault, fault);
    EXPECT_EQ(status.faults, 1);
    if (!r->real_time()) {
      EXPECT_EQ(status.ticks, 10);
      EXPECT_EQ(status.force, Vec3::Zero());
      EXPECT_EQ(r->motor_force(), Vec3::Zero());
      if (fault != DeviceFault::kUnplugged) {
        EXPECT_EQ(r->commanded_force(), Vec3::Zero());
      }
    }
    r->device().stop();
    EXPECT_EQ(r->motor_force(), Vec3::Zero());
    EXPECT_EQ(r->device().status().force, Vec3::Zero());
    if (fault != DeviceFault::kUnplugged) {
      EXPECT_EQ(r->commanded_force(), Vec3::Zero());
    }
    EXPECT_EQ(r->device().status().last_fault, fault);
    EXPECT_EQ(r->device().status().ticks, static_cast<std::int64_t>(client.readings.size()));
    for (const DeviceReading& reading : client.readings)
      EXPECT_EQ(reading.fault, DeviceFault::kNone);

    if (fault != DeviceFault::kUnplugged) {  // the cause is gone: it runs again
      Recorder again(Vec3(0, 1, 0));
      r->device().start(again);
      r->run(10);
      EXPECT_EQ(r->device().status().last_fault, DeviceFault::kNone);
      r->device().stop();
      EXPECT_GE(again.readings.size(), 10u);
    }
  }
}

TEST_P(Conformance, AClientThatThrowsIsStoppedAtZeroForce) {
  struct Thrower : Recorder {
    using Recorder::Recorder;
    Vec3 tick(const DeviceReading& reading) override {
      Recorder::tick(reading);
      if (reading.tick == 5) throw std::runtime_error("no");
      return force;
    }
  };
  const auto r = rig();
  Thrower client(Vec3(1, 0, 0));
  r->device().start(client);
  r->run(20);
  EXPECT_EQ(r->device().status().state, ServoState::kFaulted);
  r->device().stop();
  EXPECT_EQ(r->device().status().last_fault, DeviceFault::kClient);
  EXPECT_EQ(client.readings.size(), 6u);
  EXPECT_EQ(r->motor_force(), Vec3::Zero());
}

TEST_P(Conformance, AForceThatIsNotFiniteIsNotSent) {
  struct Dizzy : Recorder {
    using Recorder::Recorder;
    Vec3 tick(const DeviceReading& reading) override {
      Recorder::tick(reading);
      if (reading.tick == 5) return Vec3(0, std::numeric_limits<double>::quiet_NaN(), 0);
      if (reading.tick == 6) return Vec3(std::numeric_limits<double>::infinity(), 0, 0);
      return force;
    }
  };
  const auto r = rig();
  Dizzy client(Vec3(1, 0, 0));
  r->device().start(client);
  r->run(20);
  r->device().stop();
  ASSERT_GE(client.readings.size(), 10u);
  for (std::size_t i = 1; i < client.readings.size(); ++i)
    EXPECT_EQ(client.readings[i].previous_force, i == 6 || i == 7 ? Vec3(0, 0, 0) : client.force);
  EXPECT_EQ(r->device().status().last_fault, DeviceFault::kBadForce);
  EXPECT_EQ(r->device().status().faults, 1);
}

TEST_P(Conformance, StopFromWithinATickMakesTheForceZeroForGood) {
  struct Quitter : Recorder {
    using Recorder::Recorder;
    HapticDevice* device = nullptr;
    Vec3 tick(const DeviceReading& reading) override {
      Recorder::tick(reading);
      if (reading.tick == 5) device->stop();
      return force;
    }
  };
  const auto r = rig();
  Quitter client(Vec3(1, 0, 0));
  client.device = &r->device();
  r->device().start(client);
  if (r->real_time()) {
    sleep_until(monotonic_time() + 0.02);
    while (r->device().status().ticks < 6) sleep_until(monotonic_time() + 1e-3);
  } else {
    r->run(20);
    EXPECT_EQ(r->commanded_force(), Vec3::Zero());
  }
  r->device().stop();
  EXPECT_EQ(client.readings.size(), 6u);
  EXPECT_EQ(r->motor_force(), Vec3::Zero());
}

TEST_P(Conformance, TheMirrorHandArrivesInTheSameTickAndGetsNoForce) {
  RigSettings s;
  s.hand.position = Vec3(20, 0, 0);
  s.mirror.emplace();
  s.mirror->position = Vec3(-30, 10, 5);
  s.mirror->buttons = 2;
  const auto r = rig(s);
  ASSERT_NE(r->device().mirror_identity(), nullptr);
  EXPECT_NE(r->device().mirror_identity()->name, r->device().identity().name);
  Recorder client(Vec3(1, 1, 1));
  r->device().start(client);
  r->run(200);
  r->device().stop();
  for (const DeviceReading& reading : client.readings) {
    ASSERT_TRUE(reading.mirror.has_value());
    EXPECT_LT((reading.mirror->position - s.mirror->position).cwiseAbs().maxCoeff(), 0.0116);
    EXPECT_EQ(reading.mirror->buttons, 2u);
  }
  // The grinding hand was pushed away, and by its own force only.
  EXPECT_GT((client.readings.back().hand.position - s.hand.position).minCoeff(), 1.0);
}

TEST_P(Conformance, MissedTicksAreCounted) {
  RigSettings s;
  s.missed_every = 10;
  const auto r = rig(s);
  Recorder client;
  r->device().start(client);
  r->run(r->real_time() ? 91 : 100);
  r->device().stop();
  std::int64_t missed = 0;
  for (const DeviceReading& reading : client.readings) missed += reading.missed;
  EXPECT_EQ(r->device().status().missed_ticks, missed);
  if (!GetParam().openhaptics && !r->real_time()) {
    // Of 100 ticks of the clock the 10th, 20th, ... don't come, and the last of them isn't followed
    // by another that could notice.
    EXPECT_EQ(client.readings.size(), 90u);
    EXPECT_EQ(missed, 9);
  }
  // In real time a busy machine adds its own, and may hide some behind ticks that came late.
  if (r->real_time()) {
    EXPECT_GE(missed, 1);
  }
}

TEST_P(Conformance, TellsWhatItIs) {
  const auto r = rig();
  EXPECT_FALSE(r->device().identity().name.empty());
  EXPECT_THAT(r->device().identity().model, HasSubstr("Desktop"));
  EXPECT_FALSE(r->device().identity().vendor.empty());
  EXPECT_EQ(r->device().mirror_identity(), nullptr);
  const DeviceLimits& limits = r->device().limits();
  EXPECT_DOUBLE_EQ(limits.max_force, 7.9);
  EXPECT_DOUBLE_EQ(limits.max_continuous_force, 1.75);
  EXPECT_DOUBLE_EQ(limits.max_stiffness, 1.0);
  EXPECT_DOUBLE_EQ(limits.max_damping, 5e-3);
  EXPECT_TRUE(limits.notes.empty());
  EXPECT_EQ(r->device().calibration(), Calibration::kOk);
}

INSTANTIATE_TEST_SUITE_P(Devices, Conformance,
                         ::testing::Values(Kind{"SimulatedStepped", false, false},
                                           Kind{"SimulatedRealTime", false, true},
                                           Kind{"OpenHapticsStepped", true, false},
                                           Kind{"OpenHapticsRealTime", true, true}),
                         [](const auto& kind) { return std::string(kind.param.name); });

}  // namespace
}  // namespace toothprep::testing
