#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/device/high_pass_rms.h"

namespace toothprep {
namespace {

std::vector<double> sine(std::size_t n, double frequency, double phase = 0.3) {
  std::vector<double> x(n);
  for (std::size_t i = 0; i < n; ++i)
    x[i] = std::sin(2 * units::kPi * frequency * 1e-3 * static_cast<double>(i) + phase);
  return x;
}

std::vector<double> sum(std::vector<double> a, const std::vector<double>& b, double scale) {
  for (std::size_t i = 0; i < a.size(); ++i) a[i] += scale * b[i];
  return a;
}

TEST(HighPassRms, ASineAboveTheCornerKeepsItsRms) {
  for (const double frequency : {30.0, 50.0, 123.4, 333.3, 487.0})
    for (const double phase : {0.0, 0.7, 1.5})
      EXPECT_NEAR(rms_above(sine(1501, frequency, phase), 1000, 20), std::sqrt(0.5),
                  0.01 * std::sqrt(0.5))
          << frequency;
}

TEST(HighPassRms, ASineBelowTheCornerIsTakenOff) {
  // Not whole periods: what leaks is the kink of the mirrored continuation.
  for (const double frequency : {0.3, 1.0, 2.7, 5.0})
    for (const double phase : {0.0, 0.7, 1.5})
      EXPECT_LT(rms_above(sine(1501, frequency, phase), 1000, 20), frequency < 4 ? 0.01 : 0.02)
          << frequency;
}

TEST(HighPassRms, ALineIsTakenOffCompletelyAndASlowRiseAlmost) {
  std::vector<double> line(1501), rise(1501);
  for (std::size_t i = 0; i < line.size(); ++i) {
    line[i] = 3 + 0.01 * static_cast<double>(i);
    rise[i] = 1 - std::exp(-1e-3 * static_cast<double>(i) / 0.5);
  }
  EXPECT_LT(rms_above(line, 1000, 20), 1e-12);
  EXPECT_LT(rms_above(rise, 1000, 20), 1e-3);
  EXPECT_NEAR(rms_above(sum(rise, sine(1501, 80), 0.1), 1000, 20), 0.1 * std::sqrt(0.5), 1e-3);
}

TEST(HighPassRms, SinesAddInSquares) {
  const auto x = sum(sum(sine(2000, 100), sine(2000, 240), 0.5), sine(2000, 3), 2);
  EXPECT_NEAR(rms_above(x, 1000, 20), std::sqrt(0.5 + 0.125), 0.02);
}

TEST(HighPassRms, ItIsAPureScale) {
  const auto x = sine(1000, 60);
  std::vector<double> y = x;
  for (double& v : y) v *= -4;
  EXPECT_DOUBLE_EQ(rms_above(y, 1000, 20), 4 * rms_above(x, 1000, 20));
}

TEST(HighPassRms, AwkwardLengthsAreQuickAndGiveTheSame) {
  // 20011 is prime: as it is, the transform would take some 10⁹ operations.
  EXPECT_NEAR(rms_above(sine(20011, 50), 1000, 20), std::sqrt(0.5), 1e-3);
  EXPECT_NEAR(rms_above(sine(997, 50), 1000, 20), std::sqrt(0.5), 0.01);
}

TEST(HighPassRms, NonsenseIsRefused) {
  const auto x = sine(1000, 50);
  EXPECT_THROW(rms_above(x, 0, 20), Error);
  EXPECT_THROW(rms_above(x, 1000, 0), Error);
  EXPECT_THROW(rms_above(x, 1000, 500), Error);
  EXPECT_THROW(rms_above({}, 1000, 20), Error);
  EXPECT_THROW(rms_above(sine(99, 50), 1000, 20), Error);  // two periods are 100 samples
  auto bad = x;
  bad[5] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(rms_above(bad, 1000, 20), Error);
}

}  // namespace
}  // namespace toothprep
