#include <gtest/gtest.h>

#include "made_recording.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/rig_check/rig_figures.h"

namespace toothprep {
namespace {

using testing::erase_row;
using testing::kPeriod;
using testing::made_recording;

const RigMethod kMethod;

TEST(ServoFigures, AnExactClockHasNoJitter) {
  const auto f = servo_figures(made_recording(5000), kMethod);
  ASSERT_TRUE(f);
  EXPECT_NEAR(f->median, kPeriod, 1e-12);  // times near 5 s hold 1e-15 s
  EXPECT_NEAR(f->worst, kPeriod, 1e-12);
  EXPECT_NEAR(f->jitter_rms, 0, 1e-12);
  EXPECT_NEAR(f->clock_error_ppm, 0, 1e-6);
  EXPECT_EQ(f->late_share, 0);
  EXPECT_EQ(f->missed_by_times, 0);
}

// Lateness uniform in [0, w): standard deviation w/sqrt(12). The relative scatter of a sample's rms
// is sqrt((kurtosis - 1)/N)/2 = sqrt(0.8/N)/2 = 0.3 % for 20000 ticks: five of them.
TEST(ServoFigures, JitterOfAUniformLatenessIsItsWidthOverRootTwelve) {
  constexpr double kWidth = 200e-6;
  SessionRecording r = made_recording(20000);
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> late(0, kWidth);
  for (double& t : r.servo_time) t += late(random);
  const auto f = servo_figures(r, kMethod);
  ASSERT_TRUE(f);
  EXPECT_NEAR(f->jitter_rms / (kWidth / std::sqrt(12.0)), 1, 0.016);
  // The line tilts by its own error, sigma sqrt(12/N) from end to end: 0.7 % of the width.
  EXPECT_LE(f->jitter_peak_to_peak, kWidth * 1.03);
  EXPECT_GE(f->jitter_peak_to_peak, kWidth * 0.97);
  // The difference of two is triangular: 99.9 % of the periods are below T + w (1 - sqrt(0.002)).
  EXPECT_NEAR(f->p999, kPeriod + kWidth * (1 - std::sqrt(0.002)), 0.01 * kWidth);
  EXPECT_EQ(f->missed_by_times, 0);
  EXPECT_EQ(f->late_share, 0);
}

// The slope's standard error is sigma sqrt(12/N^3) = 58 us * 1.2e-6 per tick: 0.07 ppm of T.
TEST(ServoFigures, AClockThatRunsFastIsSeenThroughTheJitter) {
  SessionRecording r = made_recording(20000);
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> late(0, 200e-6);
  for (double& t : r.servo_time) t = t / (1 + 300e-6) + late(random);
  const auto f = servo_figures(r, kMethod);
  ASSERT_TRUE(f);
  EXPECT_NEAR(f->clock_error_ppm, 300, 0.4);
  EXPECT_EQ(f->missed_by_times, 0);
}

TEST(ServoFigures, MissedTicksAreCountedByTheDeviceAndByTheTimes) {
  SessionRecording r = made_recording(10000);
  long missing = 0;
  for (int i = 9899; i > 0; i -= 100) {
    erase_row(r, static_cast<std::size_t>(i));
    r.missed[static_cast<std::size_t>(i)] = 1;
    ++missing;
  }
  for (std::size_t i = 0; i < r.tick.size(); ++i) r.tick[i] = static_cast<std::int64_t>(i);
  const auto f = servo_figures(r, kMethod);
  ASSERT_TRUE(f);
  EXPECT_EQ(f->missed_by_device, missing);
  EXPECT_EQ(f->missed_by_times, missing);
  EXPECT_NEAR(f->missed_share, static_cast<double>(missing) / 9999, 1e-12);
  // Each of them is one period of 2 T among the remaining ones.
  EXPECT_NEAR(f->late_share, 99.0 / (9999 - 99), 1e-12);
  EXPECT_NEAR(f->worst, 2 * kPeriod, 1e-12);
  EXPECT_NEAR(f->jitter_rms, 0, 1e-12);  // a missing tick is no jitter
}

TEST(ServoFigures, ALateTickIsNoMissedTick) {
  SessionRecording r = made_recording(10000);
  for (std::size_t i = 99; i + 1 < 10000; i += 100) {
    r.servo_time[i] += 0.6 * kPeriod;
    r.missed[i] = 1;  // 1.6 periods, rounded, less one: what a device makes of it
  }
  const auto f = servo_figures(r, kMethod);
  ASSERT_TRUE(f);
  EXPECT_EQ(f->missed_by_times, 0);
  EXPECT_EQ(f->missed_by_device, 99);
  EXPECT_NEAR(f->late_share, 99.0 / 9999, 1e-12);
  EXPECT_NEAR(f->worst, 1.6 * kPeriod, 1e-12);
  // One tick in a hundred late by 0.6 T: sqrt(p (1 - p)) 0.6 T about the mean.
  EXPECT_NEAR(f->jitter_rms, std::sqrt(0.0099 * 0.9901) * 0.6 * kPeriod, 1e-9);
}

TEST(ServoFigures, ExactQuantiles) {
  SessionRecording r = made_recording(1001);
  // 1000 periods: 998 of 1 ms, one of 1.3 ms, one of 1.7 ms.
  for (std::size_t i = 200; i < 1001; ++i) r.servo_time[i] += 0.3e-3;
  for (std::size_t i = 700; i < 1001; ++i) r.servo_time[i] += 0.7e-3;
  const auto f = servo_figures(r, kMethod);
  ASSERT_TRUE(f);
  EXPECT_NEAR(f->median, 1e-3, 1e-12);
  EXPECT_NEAR(f->p999, 1.3e-3, 1e-12);
  EXPECT_NEAR(f->worst, 1.7e-3, 1e-12);
  EXPECT_NEAR(f->late_share, 1e-3, 1e-12);
}

TEST(ServoFigures, RowsThatTheRecorderDroppedAreNoMissedTicks) {
  SessionRecording r = made_recording(2000);
  for (int i = 0; i < 10; ++i) erase_row(r, 1000);
  r.dropped_ticks = 10;
  const auto f = servo_figures(r, kMethod);
  ASSERT_TRUE(f);
  EXPECT_EQ(f->missed_by_times, 0);
  EXPECT_NEAR(f->worst, kPeriod, 1e-12);
  EXPECT_EQ(recorder_figures(r).gaps_in_count, 10);
  EXPECT_EQ(unreplayable(r), "10 ticks lack that the recorder dropped");
}

TEST(StepCost, QuantilesWithoutTheFirstTick) {
  SessionRecording r = made_recording(1001);
  r.step_seconds[0] = 5e-3;
  for (std::size_t i = 1; i <= 1000; ++i) r.step_seconds[i] = static_cast<double>(i) * 1e-7;
  const auto f = step_cost_figures(r);
  ASSERT_TRUE(f);
  EXPECT_DOUBLE_EQ(f->median, 50e-6);
  EXPECT_DOUBLE_EQ(f->p99, 99e-6);
  EXPECT_DOUBLE_EQ(f->p999, 99.9e-6);
  EXPECT_DOUBLE_EQ(f->worst, 100e-6);
  EXPECT_DOUBLE_EQ(f->p999_share, 0.0999);
}

TEST(Recording, WhatCannotBeIsRefused) {
  EXPECT_THROW(check_recording(SessionRecording()), Error);
  EXPECT_NO_THROW(check_recording(made_recording(1)));
  SessionRecording r = made_recording(10);
  r.flags.pop_back();
  EXPECT_THROW(check_recording(r), Error);
  r = made_recording(10);
  r.servo_time[5] = r.servo_time[4];
  EXPECT_THROW(check_recording(r), Error);
  r = made_recording(10);
  r.device_position[3][1] = std::nan("");
  EXPECT_THROW(check_recording(r), Error);
  r = made_recording(10);
  r.header.rate_hz = 0;
  EXPECT_THROW(check_recording(r), Error);
}

TEST(Recording, TooShortIsSaidNotGuessed) {
  EXPECT_EQ(servo_figures(made_recording(99), kMethod).why_not, "fewer than 100 ticks");
  EXPECT_FALSE(step_cost_figures(made_recording(50)));
  EXPECT_FALSE(device_port_figures(made_recording(1)));
  EXPECT_FALSE(thermal_figures(made_recording(1), kMethod));
}

}  // namespace
}  // namespace toothprep
