// How much of a square lies on one side of a line, against counting.
#include <gtest/gtest.h>

#include <random>

#include "toothprep/step/grinding/covered_part.h"

namespace toothprep::testing {
namespace {

double within(std::mt19937& engine, double low, double high) {
  return low + (high - low) * (static_cast<double>(engine()) / 4294967296.0);
}

TEST(CoveredPart, ShareAndMiddleAreThoseOfTheSquareUnderTheLine) {
  std::mt19937 engine(3);
  constexpr int kLines = 300;
  for (int trial = 0; trial < 200; ++trial) {
    const double c = within(engine, -1.5, 1.5), a = within(engine, -1, 1),
                 b = within(engine, -1, 1);
    double share = 0, x = 0, y = 0;
    for (int i = 0; i < kLines; ++i)
      for (int j = 0; j < kLines; ++j) {
        const double u = (2 * i + 1.0) / kLines - 1, v = (2 * j + 1.0) / kLines - 1;
        if (c + a * u + b * v < 0) share += 1, x += u, y += v;
      }
    const auto part =
        covered_part<float>(static_cast<float>(c), static_cast<float>(a), static_cast<float>(b));
    // A line misjudges at most the points that it crosses, one or two a row.
    EXPECT_NEAR(part.share, share / kLines / kLines, 2.0 / kLines) << c << " " << a << " " << b;
    if (share < 0.01 * kLines * kLines) continue;
    EXPECT_NEAR(part.x, x / share, 0.02) << c << " " << a << " " << b;
    EXPECT_NEAR(part.y, y / share, 0.02) << c << " " << a << " " << b;
  }
}

TEST(CoveredPart, AFieldWithoutRangeCoversAllOrNothing) {
  EXPECT_NEAR(covered_part<float>(-0.1f, 0, 0).share, 1, 1e-6);
  EXPECT_NEAR(covered_part<float>(0.1f, 0, 0).share, 0, 1e-6);
}

TEST(CoveredPart, FourAtATimeAreTheSameToTheLastBit) {
  std::mt19937 engine(4);
  for (int trial = 0; trial < 1000; ++trial) {
    Float4 c{}, a{}, b{};
    for (int p = 0; p < 4; ++p) {
      c[p] = static_cast<float>(within(engine, -1.5, 1.5));
      a[p] = static_cast<float>(within(engine, -1, 1));
      b[p] = static_cast<float>(within(engine, -1, 1));
    }
    const auto four = covered_part<Float4>(c, a, b);
    for (int p = 0; p < 4; ++p) {
      const auto one = covered_part<float>(c[p], a[p], b[p]);
      EXPECT_EQ(four.share[p], one.share);
      EXPECT_EQ(four.x[p], one.x);
      EXPECT_EQ(four.y[p], one.y);
    }
  }
}

}  // namespace
}  // namespace toothprep::testing
