#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "rig.h"
#include "toothprep/step/core/errors.h"

namespace toothprep::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

SimulatedSettings stepped() {
  SimulatedSettings s;
  s.real_time = false;
  s.ramp = 0;
  return s;
}

// A wall at y = 0 of 0.5 N/mm.
struct Wall : Recorder {
  Vec3 tick(const DeviceReading& reading) override {
    force = Vec3(0, -0.5 * std::min(0.0, reading.hand.position.y()), 0);
    return Recorder::tick(reading);
  }
};

TEST(SimulatedDevice, GivesTheSameBitsEveryTime) {
  SimulatedSettings s = stepped();
  s.disturbances.encoder_noise = 0.01;
  s.disturbances.jitter = 1e-4;
  s.disturbances.missed_every = 7;
  std::vector<DeviceReading> first;
  for (int repeat = 0; repeat < 2; ++repeat) {
    SimulatedDevice device(s);
    Wall client;
    device.start(client);
    device.run(2000);
    device.stop();
    if (repeat == 0) {
      first = client.readings;
      continue;
    }
    ASSERT_EQ(client.readings.size(), first.size());
    double deepest = 0;
    for (std::size_t i = 0; i < first.size(); ++i) {
      EXPECT_EQ(client.readings[i].time, first[i].time);
      EXPECT_EQ(client.readings[i].hand.position, first[i].hand.position);
      EXPECT_EQ(client.readings[i].previous_force, first[i].previous_force);
      deepest = std::max(deepest, first[i].previous_force.y());
    }
    EXPECT_GT(deepest, 0.5);  // it did meet the wall
  }
}

TEST(SimulatedDevice, TheHandFollowsItsPathAndPressesItsButtons) {
  std::vector<HandleSample> path(3);
  for (int i = 0; i < 3; ++i) path[i].time = 7.0 + 0.5 * i;  // its first sample is time 0
  path[1].pose.position = path[2].pose.position = Vec3(5, 0, -5);
  path[2].pose.orientation = Quat(Eigen::AngleAxisd(1.0, Vec3::UnitX()));
  path[0].buttons = 0;
  path[1].buttons = 1;
  path[2].buttons = 2;
  SimulatedSettings s = stepped();
  s.motion = hand_along(path);
  SimulatedDevice device(s);
  Recorder client;
  device.start(client);
  device.run(1500);
  device.stop();
  const auto at = [&](int ms) { return client.readings[ms].hand; };
  EXPECT_EQ(at(0).position, Vec3::Zero());
  // At 10 mm/s per axis the hand's spring and damper lag by at most friction over stiffness and
  // (m + m_h) and b terms far below; 0.06/0.3 = 0.2 mm.
  EXPECT_LT((at(250).position - Vec3(2.5, 0, -2.5)).norm(), 0.5);
  EXPECT_LT((at(1400).position - Vec3(5, 0, -5)).norm(), 0.4);
  EXPECT_EQ(at(499).buttons, 0u);
  EXPECT_EQ(at(500).buttons, 1u);
  EXPECT_EQ(at(1000).buttons, 2u);
  EXPECT_NEAR(Eigen::AngleAxisd(at(750).orientation).angle(), 0.5, 1e-12);
  EXPECT_NEAR(Eigen::AngleAxisd(at(1400).orientation).angle(), 1.0, 1e-12);
}

TEST(SimulatedDevice, DisturbancesAreTheOnesAskedFor) {
  SimulatedSettings s = stepped();
  s.motion = resting_hand(DevicePose());
  s.phantom.encoder_count = 0;
  s.disturbances.encoder_noise = 0.02;
  s.disturbances.jitter = 3e-4;
  s.disturbances.late_every = 100;
  s.disturbances.late = 1e-4;
  s.disturbances.missed_every = 50;
  SimulatedDevice device(s);
  Recorder client;
  device.start(client);
  device.run(10000);
  device.stop();
  // 10000 less every 50th.
  ASSERT_EQ(client.readings.size(), 9800u);
  double sum = 0, squares = 0, latest = 0, lateness_sum = 0;
  for (const DeviceReading& r : client.readings) {
    for (int axis = 0; axis < 3; ++axis) {
      sum += r.hand.position[axis];
      squares += r.hand.position[axis] * r.hand.position[axis];
    }
    const double lateness = r.time - std::floor(r.time * 1000 + 1e-6) * 1e-3;
    latest = std::max(latest, lateness);
    lateness_sum += lateness;
  }
  const double n = 3.0 * static_cast<double>(client.readings.size());
  // Standard errors: sigma/sqrt(n) of the mean, sigma/sqrt(2n) of the deviation; five of each.
  EXPECT_LT(std::abs(sum / n), 5 * 0.02 / std::sqrt(n));
  EXPECT_NEAR(std::sqrt(squares / n), 0.02, 5 * 0.02 / std::sqrt(2 * n));
  // Uniform in [0, 0.3 ms): mean 0.15 ms, deviation 0.3/sqrt(12) ms. (The late ticks fall on missed
  // ones here, every 100th of every 50th.)
  EXPECT_NEAR(lateness_sum / 9800, 1.5e-4, 5 * 3e-4 / std::sqrt(12.0 * 9800));
  EXPECT_LT(latest, 3e-4);
  EXPECT_GT(latest, 2.99e-4);
  EXPECT_EQ(device.status().missed_ticks, 10000 / 50 - 1);  // the last one is the run's last tick
}

TEST(SimulatedDevice, NeedsToBeStartedInTheRightMode) {
  SimulatedDevice device(stepped());
  EXPECT_THAT([&] { device.run(1); }, ThrowsMessage<Error>(HasSubstr("not started")));
  SimulatedDevice real_time{SimulatedSettings()};
  EXPECT_THAT([&] { real_time.run(1); }, ThrowsMessage<Error>(HasSubstr("real time")));
  SimulatedSettings s = stepped();
  s.disturbances.jitter = 2e-3;
  EXPECT_THROW(SimulatedDevice{s}, Error);
  s = stepped();
  s.disturbances.missed_every = 1;
  EXPECT_THROW(SimulatedDevice{s}, Error);
}

TEST(SimulatedDevice, WithADelayTheMotorsStillEndAtZero) {
  SimulatedSettings s = stepped();
  s.phantom.delay_ticks = 3;
  SimulatedDevice device(s);
  Recorder client(Vec3(1, 0, 0));
  device.start(client);
  device.run(10);
  EXPECT_EQ(device.phantom().motor_force(), client.force);
  device.stop();
  EXPECT_EQ(device.phantom().motor_force(), Vec3::Zero());
}

TEST(HandMotion, RefusesPathsThatAreNone) {
  EXPECT_THROW(hand_along({}), Error);
  std::vector<HandleSample> path(2);
  EXPECT_THROW(hand_along(path), Error);
  path[1].time = std::nan("");
  EXPECT_THROW(hand_along(path), Error);
}

}  // namespace
}  // namespace toothprep::testing
