#include <gtest/gtest.h>

#include <limits>

#include "rig.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/device/servo.h"

namespace toothprep::testing {
namespace {

const double kNaN = std::numeric_limits<double>::quiet_NaN();

TEST(Servo, HoldsTheLastGoodReadingAndSendsZeroForABadOne) {
  Servo servo(5, 1e-3, 0);
  Recorder client(Vec3(1, 0, 0));
  servo.open(client);
  DevicePose pose;
  pose.position = Vec3(kNaN, 0, 0);
  // Nothing good to hold yet: the client isn't called.
  EXPECT_EQ(servo.begin_tick(0, pose, nullptr, DeviceFault::kNone), Vec3::Zero());
  servo.end_tick();
  EXPECT_TRUE(client.readings.empty());

  pose.position = Vec3(1, 2, 3);
  EXPECT_EQ(servo.begin_tick(1e-3, pose, nullptr, DeviceFault::kNone), client.force);
  DevicePose bad = pose;
  bad.position.y() = std::numeric_limits<double>::infinity();
  EXPECT_EQ(servo.begin_tick(2e-3, bad, nullptr, DeviceFault::kNone), Vec3::Zero());
  bad = pose;
  bad.orientation = Quat(0, 0, 0, 0);
  EXPECT_EQ(servo.begin_tick(3e-3, bad, nullptr, DeviceFault::kNone), Vec3::Zero());
  EXPECT_EQ(servo.begin_tick(4e-3, pose, &bad, DeviceFault::kNone), Vec3::Zero());
  EXPECT_EQ(servo.begin_tick(5e-3, pose, nullptr, DeviceFault::kNone), client.force);
  ASSERT_EQ(client.readings.size(), 5u);
  for (const DeviceReading& reading : client.readings) {
    EXPECT_EQ(reading.hand.position, Vec3(1, 2, 3));
    EXPECT_EQ(reading.hand.orientation.coeffs(), Quat::Identity().coeffs());
  }
  EXPECT_EQ(client.readings[1].fault, DeviceFault::kBadReading);
  EXPECT_EQ(servo.status().faults, 2);  // one at the start, one from tick 1 to 3
  EXPECT_EQ(servo.status().last_fault, DeviceFault::kBadReading);
}

TEST(Servo, ThatWasAbandonedCallsItsClientNoMoreEvenIfItIsOpenedAgain) {
  Servo servo(5, 1e-3, 0);
  Recorder client(Vec3(1, 0, 0));
  servo.open(client);
  EXPECT_EQ(servo.begin_tick(0, {}, nullptr, DeviceFault::kNone), client.force);
  servo.abandon(1);
  EXPECT_EQ(servo.begin_tick(1e-3, {}, nullptr, DeviceFault::kNone), Vec3::Zero());
  servo.open(client);
  EXPECT_EQ(servo.begin_tick(2e-3, {}, nullptr, DeviceFault::kNone), Vec3::Zero());
  EXPECT_EQ(client.readings.size(), 1u);
}

TEST(Servo, AFaultFoundBetweenTicksActsOnTheNextOneAndIsCountedOnce) {
  Servo servo(5, 1e-3, 0);
  Recorder client(Vec3(1, 0, 0));
  servo.open(client);
  servo.begin_tick(0, {}, nullptr, DeviceFault::kNone);
  servo.report(DeviceFault::kWarmMotors);
  EXPECT_EQ(servo.status().last_fault, DeviceFault::kWarmMotors);
  for (int i = 1; i <= 3; ++i) {
    EXPECT_EQ(servo.begin_tick(1e-3 * i, {}, nullptr, DeviceFault::kNone), Vec3::Zero());
    if (i < 3) servo.report(DeviceFault::kWarmMotors);
  }
  EXPECT_EQ(servo.begin_tick(4e-3, {}, nullptr, DeviceFault::kNone), client.force);
  EXPECT_EQ(servo.status().faults, 1);
}

TEST(Servo, AFinalFaultIsToldBeforeATransientOne) {
  Servo servo(5, 1e-3, 0);
  Recorder client(Vec3(1, 0, 0));
  servo.open(client);
  servo.report(worse_of(DeviceFault::kCommunication, DeviceFault::kWarmMotors));
  servo.report(DeviceFault::kVelocityExceeded);
  EXPECT_EQ(servo.begin_tick(0, {}, nullptr, DeviceFault::kNone), Vec3::Zero());
  EXPECT_EQ(servo.status().state, ServoState::kFaulted);
  EXPECT_EQ(servo.status().last_fault, DeviceFault::kCommunication);
  EXPECT_TRUE(client.readings.empty());
}

TEST(Servo, AHugeForceIsClampedToo) {
  Servo servo(5, 1e-3, 0);
  Recorder client(Vec3(1e300, 0, -1e300));  // its plain norm overflows
  servo.open(client);
  const Vec3 force = servo.begin_tick(0, {}, nullptr, DeviceFault::kNone);
  EXPECT_LT((force - Vec3(5, 0, -5) / std::sqrt(2)).norm(), 1e-12);
}

TEST(Servo, CountsThePeriodsBetweenTicks) {
  Servo servo(5, 1e-3, 0);
  Recorder client;
  servo.open(client);
  // Late by 0.4 of a period isn't a missed tick; 4.1 periods are three.
  for (const double time : {0.0, 1.4e-3, 2e-3, 6.1e-3, 7e-3})
    servo.begin_tick(time, {}, nullptr, DeviceFault::kNone);
  EXPECT_EQ(client.readings[1].missed, 0);
  EXPECT_EQ(client.readings[3].missed, 3);
  EXPECT_EQ(servo.status().missed_ticks, 3);
}

TEST(Servo, RefusesWhatCannotBe) {
  EXPECT_THROW(Servo(0, 1e-3, 0), Error);
  EXPECT_THROW(Servo(kNaN, 1e-3, 0), Error);
  EXPECT_THROW(Servo(5, 0, 0), Error);
  EXPECT_THROW(Servo(5, 1e-3, -1), Error);
}

TEST(DeviceFault, EveryOneHasASeverityAndALineOfItsOwn) {
  std::vector<std::string> lines;
  for (int i = 0; i <= static_cast<int>(DeviceFault::kUnplugged); ++i) {
    const auto fault = static_cast<DeviceFault>(i);
    const std::string line = describe(fault);
    for (const std::string& other : lines) EXPECT_NE(line, other);
    lines.push_back(line);
    const FaultSeverity expected = i == 0                                ? FaultSeverity::kNone
                                   : fault < DeviceFault::kNotCalibrated ? FaultSeverity::kTransient
                                                                         : FaultSeverity::kFinal;
    EXPECT_EQ(severity_of(fault), expected);
    // What stops says so; what goes on says that the force is zero.
    if (expected == FaultSeverity::kFinal) {
      EXPECT_NE(line.find("stopped"), std::string::npos);
    }
    if (expected == FaultSeverity::kTransient) {
      EXPECT_NE(line.find("zero force"), std::string::npos);
    }
  }
}

}  // namespace
}  // namespace toothprep::testing
