// How much of a square lies on one side of a line, against counting.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <random>

#include "toothprep/step/grinding/contact_frame.h"
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

// Lines that cut a corner off as well, along which x², y² and x y aren't what they are on average.
TEST(CoveredPart, OfABentBorderIsThatOfTheStraightOneThatDividesThePieceAlike) {
  std::mt19937 engine(7);
  constexpr int kLines = 300;
  double squares = 0, squares_straight = 0;
  int count = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const auto value = [&](double bound) {
      return static_cast<float>(within(engine, -bound, bound));
    };
    const float c = value(1.5), a = value(1), b = value(1), d = value(0.04), e = value(0.04),
                f = value(0.1);
    if (std::max(std::abs(a), std::abs(b)) < 0.5f) continue;
    double share = 0;
    for (int i = 0; i < kLines; ++i)
      for (int j = 0; j < kLines; ++j) {
        const float x = (2 * static_cast<float>(i) + 1) / kLines - 1,
                    y = (2 * static_cast<float>(j) + 1) / kLines - 1;
        if (c + a * x + b * y + d * x * x + e * y * y + f * x * y < 0) share += 1;
      }
    share /= kLines * kLines;
    const Float4 middle = straightened(all4(c), all4(a), all4(b), all4(d), all4(e), all4(f));
    const double found = covered_part<float>(middle[0], a, b).share;
    EXPECT_NEAR(found, share, 0.02)
        << c << " " << a << " " << b << " " << d << " " << e << " " << f;
    const double straight = covered_part<float>(c, a, b).share;
    squares += (found - share) * (found - share);
    squares_straight += (straight - share) * (straight - share);
    ++count;
  }
  std::printf("rms %.5f, as straight lines %.5f\n", std::sqrt(squares / count),
              std::sqrt(squares_straight / count));
  EXPECT_LT(std::sqrt(squares / count), 0.002);
  EXPECT_GT(std::sqrt(squares_straight / count), 0.006);
}

// So a bur lies on the wall of its own slot as it goes back: the line is where it touches, beyond which it recedes.
TEST(CoveredPart, OfABorderThatOnlyTouchesThePieceTheLineIsWhereItDoes) {
  for (const float place : {-0.9f, -0.3f, 0.1f, 0.5f, 0.9f})
    for (const bool along : {true, false}) {
      // (u - place)² r
      const float r = 0.2f, slope = -2 * place * r;
      const Float4 c = all4(place * place * r), zero{}, bend = all4(r);
      const Float4 middle = along ? straightened(c, all4(slope), zero, bend, zero, zero)
                                  : straightened(c, zero, all4(slope), zero, bend, zero);
      EXPECT_NEAR(-middle[0] / slope, place, 0.01f);
    }
}

// Of two hundred pairs of lines what `part` makes of them, against counting the places that are `covered`.
template <class Part, class Covered>
void expect_as_counted(const Part& part, const Covered& covered) {
  std::mt19937 engine(5);
  constexpr int kLines = 300;
  const auto line = [&] {
    const auto value = [&](double bound) {
      return static_cast<float>(within(engine, -bound, bound));
    };
    return DividingLine{value(1.2), value(1), value(1)};
  };
  for (int trial = 0; trial < 200; ++trial) {
    const DividingLine first = line();
    DividingLine second = line();
    // Some alike, some opposite.
    if (trial % 4 == 1) second = {first.c + 0.1f, first.a, first.b};
    if (trial % 4 == 2) second = {0.2f - first.c, -first.a, -first.b};
    double share = 0, x = 0, y = 0;
    for (int i = 0; i < kLines; ++i)
      for (int j = 0; j < kLines; ++j) {
        const float u = (2 * static_cast<float>(i) + 1) / kLines - 1,
                    v = (2 * static_cast<float>(j) + 1) / kLines - 1;
        if (covered(first.at(u, v), second.at(u, v)))
          share += 1, x += static_cast<double>(u), y += static_cast<double>(v);
      }
    const CoveredPart<float> found = part(first, second);
    EXPECT_NEAR(found.share, share / kLines / kLines, 3.0 / kLines) << trial;
    if (share < 0.03 * kLines * kLines) continue;
    EXPECT_NEAR(found.x, x / share, 0.02) << trial;
    EXPECT_NEAR(found.y, y / share, 0.02) << trial;
  }
}

TEST(CoveredPart, ShareAndMiddleUnderTwoLinesAreThoseOfWhatLiesUnderBoth) {
  expect_as_counted(
      [](const DividingLine& a, const DividingLine& b) {
        return covered_by_all({a, b});
      },
      [](float a, float b) { return a < 0 && b < 0; });
}

TEST(CoveredPart, WithoutWhatIsOutsideOfBothItIsWhatLiesUnderEither) {
  expect_as_counted(
      [](const DividingLine& a, const DividingLine& b) {
        return without(covered_by_all({DividingLine::none()}),
                       covered_by_all({a.turned(), b.turned()}));
      },
      [](float a, float b) { return a < 0 || b < 0; });
  const CoveredPart<float> part{0.3f, 0.1f, -0.2f};
  EXPECT_EQ(without(part, part).share, 0);
}

TEST(CoveredPart, UnderALineThatLeavesNothingOrEverythingItIsNothingOrWhatTheOtherLeaves) {
  const DividingLine none{1, 0, 0}, all{-1, 0, 0}, half{0, 1, 0};
  EXPECT_EQ(covered_by_all({none, half}).share, 0);
  EXPECT_EQ(covered_by_all({half, none}).share, 0);
  EXPECT_NEAR(covered_by_all({all, half}).share, 0.5, 1e-6);
  EXPECT_NEAR(covered_by_all({half, all}).x, -0.5, 1e-6);
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
