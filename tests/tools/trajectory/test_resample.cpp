#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;

HandleSample sample(double time, const Vec3& position, const Quat& q = Quat::Identity(),
                    std::uint32_t buttons = 1) {
  HandleSample s;
  s.time = time;
  s.pose = {position, q};
  s.buttons = buttons;
  return s;
}

Quat about_z(double degrees) {
  return Quat(Eigen::AngleAxisd(units::from_degree(degrees), Vec3::UnitZ()));
}

std::string error_of(const Trajectory& t, double h, bool allow_gaps = false) {
  try {
    static_cast<void>(resample(t, h, allow_gaps, "t.csv"));
  } catch (const InputError& e) {
    return e.what();
  }
  return "no error";
}

TEST(Resample, ATrajectoryOnTheGridComesBackBitForBit) {
  Trajectory t;
  for (int i = 0; i < 500; ++i)  // within 1e-9 s of the grid, not on it
    t.samples.push_back(sample(7.25 + i * 1e-3 + ((i + 1) % 3 - 1) * 0.9e-9,
                               Vec3(std::sin(i), 0.1, i), about_z(i).normalized(),
                               static_cast<std::uint32_t>(i)));
  const auto out = resample(t, 1e-3, false, "t");
  ASSERT_EQ(out.size(), t.samples.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    ASSERT_EQ(out[i].time, t.samples[i].time);
    ASSERT_EQ(out[i].pose.position, t.samples[i].pose.position);
    ASSERT_EQ(out[i].pose.orientation.coeffs(), t.samples[i].pose.orientation.coeffs());
    ASSERT_EQ(out[i].buttons, t.samples[i].buttons);
  }
}

TEST(Resample, UniformMotionStaysUniformWhateverTheInputTimes) {
  const Vec3 from(1, -2, 3), velocity(0.5, -0.25, 2);
  Trajectory t;
  double time = 2.0;
  for (int i = 0; i < 300; ++i) {
    t.samples.push_back(
        sample(time, from + velocity * (time - 2.0), about_z(90.0 * (time - 2.0)).normalized()));
    time += 0.002 + 0.0015 * std::sin(i);
  }
  const auto out = resample(t, 1e-3, false, "t");
  EXPECT_LE(out.back().time, t.samples.back().time + 1e-9);
  EXPECT_GT(out.back().time, t.samples.back().time - 1e-3);
  for (std::size_t i = 0; i < out.size(); ++i) {
    ASSERT_EQ(out[i].time, 2.0 + static_cast<double>(i) * 1e-3);
    const double dt = out[i].time - 2.0;
    ASSERT_LT((out[i].pose.position - from - velocity * dt).norm(), 1e-12);
    // A constant turning rate is what slerp keeps: 90 degrees a second.
    ASSERT_LT(out[i].pose.orientation.angularDistance(about_z(90.0 * dt)), 1e-7);
    ASSERT_NEAR(out[i].pose.orientation.norm(), 1.0, 1e-15);
  }
}

TEST(Resample, OrientationsTurnTheShortWayAroundWhateverTheSign) {
  Trajectory t;
  Quat negative = about_z(80);
  negative.coeffs() = -negative.coeffs();  // the same orientation
  t.samples = {sample(0, Vec3::Zero()), sample(0.1, Vec3::Zero(), negative)};
  const auto out = resample(t, 0.05, false, "t");
  ASSERT_EQ(out.size(), 3u);
  EXPECT_LT(out[1].pose.orientation.angularDistance(about_z(40)), 1e-12);
}

TEST(Resample, ButtonsAreThoseOfTheLatestSample) {
  Trajectory t;
  t.samples = {sample(0, Vec3::Zero(), Quat::Identity(), 1),
               sample(0.01, Vec3::Zero(), Quat::Identity(), 0),
               sample(0.02, Vec3::Zero(), Quat::Identity(), 3)};
  const auto out = resample(t, 0.004, false, "t");
  ASSERT_EQ(out.size(), 6u);  // 0, 4, 8, 12, 16, 20 ms
  const std::uint32_t expected[] = {1, 1, 1, 0, 0, 3};
  for (int i = 0; i < 6; ++i) EXPECT_EQ(out[i].buttons, expected[i]) << i;
}

TEST(Resample, RejectedSamplesStayOnTheGridAndAreNeverInterpolated) {
  Trajectory t;
  for (int i = 0; i < 10; ++i) {
    t.samples.push_back(sample(1e-3 * i, Vec3(i, 0, 0)));
    t.measured_force.push_back(Vec3(i, 0, 0));
  }
  t.samples[4].rejected = true;
  t.samples[4].pose.position = Vec3(0, 20, 0);
  const auto same = resample(t, 1e-3, false, "t.h5");
  ASSERT_EQ(same.size(), 10u);
  EXPECT_TRUE(same[4].rejected);
  EXPECT_EQ(same[4].pose.position, Vec3(0, 20, 0));
  for (const HandleSample& s : resample(t, 0.5e-3, false, "t.h5")) {
    EXPECT_FALSE(s.rejected);
    EXPECT_NEAR(s.pose.position.x(), 1e3 * s.time, 1e-9);
    EXPECT_EQ(s.pose.position.y(), 0);
  }
  const Trajectory good = without_rejected(t);
  ASSERT_EQ(good.samples.size(), 9u);
  EXPECT_EQ(good.measured_force[4], Vec3(5, 0, 0));
}

TEST(Resample, AGapIsRefusedWithItsTimeUnlessAllowed) {
  Trajectory t;
  t.samples = {sample(0, Vec3::Zero()), sample(0.1, Vec3::UnitX()), sample(0.25, Vec3::UnitY())};
  EXPECT_THAT(error_of(t, 1e-3), HasSubstr("t.csv: time 0.100000 s: a gap of 0.150000 s"));
  EXPECT_EQ(resample(t, 1e-3, true, "t").size(), 251u);
}

TEST(Resample, WhatIsNoMotionIsRefused) {
  Trajectory t;
  EXPECT_THAT(error_of(t, 1e-3), HasSubstr("fewer than two samples"));
  t.samples = {sample(0, Vec3::Zero()), sample(0, Vec3::Zero())};
  EXPECT_THAT(error_of(t, 1e-3), HasSubstr("does not increase"));
  t.samples[1].time = 1e9;  // would be 1e12 steps
  EXPECT_THAT(error_of(t, 1e-3, true), HasSubstr("more than 20000000 steps"));
  t.samples[1].time = 1;
  EXPECT_THROW(static_cast<void>(resample(t, 0, true, "t")), Error);
}

}  // namespace
}  // namespace toothprep
