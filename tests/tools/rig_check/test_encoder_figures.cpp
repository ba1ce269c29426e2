#include <gtest/gtest.h>

#include "made_recording.h"
#include "toothprep/tools/rig_check/rig_figures.h"

namespace toothprep {
namespace {

using testing::kPeriod;
using testing::made_recording;

const RigMethod kMethod;
constexpr double kCount = 0.023;  // mm

// At rest at (10.003, -4, 77) mm with white normal noise, rounded to counts.
SessionRecording noisy(std::size_t n, double noise, std::uint64_t seed = 1) {
  SessionRecording r = made_recording(n);
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(0, noise);
  for (Vec3& x : r.device_position) {
    x = Vec3(10.003, -4, 77);
    for (int axis = 0; axis < 3; ++axis)
      x[axis] = kCount * std::floor((x[axis] + normal(random)) / kCount + 0.5);
  }
  return r;
}

class EncoderQuantum : public ::testing::TestWithParam<double> {};  // noise in counts
class EncoderNoise : public ::testing::TestWithParam<double> {};

TEST_P(EncoderQuantum, TheQuantumIsFoundInAnyNoise) {
  RigMethod method;
  method.rest_noise_mm = 1;
  method.rest_drift_mm = 1;
  const auto f = quantum_figures(noisy(10000, GetParam() * kCount), method);
  ASSERT_TRUE(f);
  EXPECT_TRUE(f->at_rest);
  for (const double count : f->axis) EXPECT_NEAR(count, kCount, 1e-9);
}

// From half a count of noise on, rounding adds D²/12 and its error is independent from tick to tick
// (the spectrum's overlap is exp(-2 pi² σ²/D²) < 1 %). Straight lines take 2 of 500 degrees of
// freedom: 0.2 %; the scatter of the rms of N = 10000 samples is 1/sqrt(2 N) = 0.7 %.
TEST_P(EncoderNoise, NoiseAndVelocityNoiseAreThoseInjected) {
  const double noise = GetParam() * kCount;
  RigMethod method;
  method.rest_noise_mm = 1;
  method.rest_drift_mm = 1;
  const auto f = rest_figures(noisy(10000, noise), method);
  ASSERT_TRUE(f);
  EXPECT_DOUBLE_EQ(f->seconds, 10);
  const double expected = std::hypot(noise, kCount / std::sqrt(12.0));
  for (const double rms : f->noise) EXPECT_NEAR(rms / expected, 1, 0.03);
  EXPECT_NEAR(f->noise_above_quantum / noise, 1, 0.05);
  for (const double rms : f->velocity_noise)
    EXPECT_NEAR(rms / (std::sqrt(2.0) * expected / kPeriod), 1, 0.03);
}

INSTANTIATE_TEST_SUITE_P(Counts, EncoderQuantum, ::testing::Values(0.25, 0.5, 1.0, 3.0, 10.0));
// Below half a count the counts hide most of the noise.
INSTANTIATE_TEST_SUITE_P(Counts, EncoderNoise, ::testing::Values(0.5, 1.0, 3.0, 10.0));

TEST(RestWindows, AMovingHandIsNotAtRest) {
  SessionRecording r = made_recording(8000);
  const HandMotion motion = gentle_hand(DevicePose());
  for (std::size_t i = 0; i < 8000; ++i)
    r.device_position[i] = motion(static_cast<double>(i) * kPeriod).position;
  EXPECT_TRUE(rest_windows(r, kMethod).empty());
  EXPECT_FALSE(rest_figures(r, kMethod));
}

TEST(RestWindows, RestIsFoundBetweenMotionsWithinAWindowOfItsEnds) {
  SessionRecording r = noisy(6000, 0.5 * kCount);
  for (std::size_t i = 0; i < 2000; ++i) {
    r.device_position[1999 - i][0] -= 20e-3 * static_cast<double>(i);
    r.device_position[4000 + i][0] += 20e-3 * static_cast<double>(i);
  }
  const auto windows = rest_windows(r, kMethod);
  ASSERT_FALSE(windows.empty());
  // A window moves on by a quarter of its length, and a few ticks of slow motion pass for rest.
  EXPECT_NEAR(static_cast<double>(windows.front().first), 2000, 126);
  EXPECT_GE(windows.size(), 3u);
  EXPECT_LE(windows.back().second, 4010u);
}

TEST(RestWindows, ForceEndsRestButTheProtocolDecides) {
  SessionRecording r = noisy(1000, 0.5 * kCount);
  for (Vec3& f : r.force_sent) f = Vec3(1, 0, 0);
  EXPECT_TRUE(rest_windows(r, kMethod).empty());
  r.header.protocol = "rest 1 s";
  EXPECT_EQ(rest_windows(r, kMethod).size(), 2u);
}

TEST(RestWindows, ADroppedRowSplitsThem) {
  SessionRecording r = noisy(1000, 0.5 * kCount);
  EXPECT_EQ(rest_windows(r, kMethod).size(), 2u);
  testing::erase_row(r, 300);
  const auto windows = rest_windows(r, kMethod);
  ASSERT_EQ(windows.size(), 1u);
  EXPECT_EQ(windows[0].first, 300u);
}

// Without noise the reading at rest is one value: the counts show while the handle moves.
TEST(Encoder, TheQuantumIsFoundInMotionToo) {
  SessionRecording r = made_recording(8000);
  const HandMotion motion = gentle_hand(DevicePose());
  for (std::size_t i = 0; i < 8000; ++i) {
    const Vec3 x = motion(static_cast<double>(i) * kPeriod).position;
    for (int axis = 0; axis < 3; ++axis)
      r.device_position[i][axis] = kCount * std::floor(x[axis] / kCount + 0.5);
  }
  const auto f = quantum_figures(r, kMethod);
  ASSERT_TRUE(f);
  EXPECT_FALSE(f->at_rest);
  for (const double count : f->axis) EXPECT_NEAR(count, kCount, 1e-9);
}

TEST(Encoder, AReadingThatNeverChangesTellsNoQuantum) {
  EXPECT_EQ(quantum_figures(made_recording(2000), kMethod).why_not,
            "the device's reading never changed");
}

}  // namespace
}  // namespace toothprep
