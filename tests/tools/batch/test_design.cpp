// The designs of a sweep, by what defines them.
#include <gmock/gmock.h>

#include <algorithm>
#include <set>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/batch/design.h"

namespace toothprep {
namespace {

using testing::ElementsAre;

Factor range(const std::string& name, double from, double to, std::size_t steps = 0) {
  Factor f;
  f.name = name;
  f.from = from;
  f.to = to;
  f.steps = steps;
  return f;
}

Factor list(const std::string& name, std::vector<std::string> values) {
  Factor f;
  f.name = name;
  f.values = std::move(values);
  return f;
}

std::vector<DesignPoint> points(DesignKind kind, std::vector<Factor> factors,
                                std::size_t samples = 0, std::vector<std::string> where = {},
                                std::uint64_t seed = 1) {
  Design d;
  d.kind = kind;
  d.factors = std::move(factors);
  d.samples = samples;
  d.seed = seed;
  for (const std::string& text : where) d.constraints.push_back(parse_constraint(text));
  return points_of(d);
}

TEST(SweepDesign, AGridHasEveryCombinationAndTheEndsOfARange) {
  EXPECT_THAT(points(DesignKind::kGrid, {list("bur", {"a", "b"}), range("u", 1, 2, 3)}),
              ElementsAre(DesignPoint{"a", "1"}, DesignPoint{"a", "1.5"}, DesignPoint{"a", "2"},
                          DesignPoint{"b", "1"}, DesignPoint{"b", "1.5"}, DesignPoint{"b", "2"}));
  Factor decades = range("k", 0.01, 100, 5);
  decades.logarithmic = true;
  std::vector<double> values;
  for (const DesignPoint& p : points(DesignKind::kGrid, {decades}))
    values.push_back(std::stod(p[0]));
  ASSERT_EQ(values.size(), 5u);
  for (std::size_t i = 1; i < 5; ++i) EXPECT_NEAR(values[i] / values[i - 1], 10, 1e-9);
}

TEST(SweepDesign, AListTakesValuesSideBySide) {
  EXPECT_THAT(points(DesignKind::kList, {list("a", {"1", "2"}), list("b", {"x", "y"})}),
              ElementsAre(DesignPoint{"1", "x"}, DesignPoint{"2", "y"}));
  EXPECT_THROW(points(DesignKind::kList, {list("a", {"1", "2"}), list("b", {"x"})}), Error);
}

TEST(SweepDesign, ALatinHypercubeHasEachFactorOnceInEachPart) {
  const std::size_t n = 50;
  const auto sample = points(DesignKind::kLatinHypercube, {range("a", 0, 1), range("b", -2, 3)}, n);
  ASSERT_EQ(sample.size(), n);
  std::vector<std::vector<std::size_t>> orders;
  for (std::size_t k = 0; k < 2; ++k) {
    std::set<std::size_t> parts;
    orders.emplace_back();
    for (const DesignPoint& p : sample) {
      const double share = k == 0 ? std::stod(p[0]) : (std::stod(p[1]) + 2) / 5;
      orders.back().push_back(static_cast<std::size_t>(share * static_cast<double>(n)));
      parts.insert(orders.back().back());
    }
    EXPECT_EQ(parts.size(), n) << k;
    EXPECT_EQ(*parts.rbegin(), n - 1);
  }
  EXPECT_NE(orders[0], orders[1]) << "the factors' orders are independent";
  EXPECT_EQ(points(DesignKind::kLatinHypercube, {range("a", 0, 1), range("b", -2, 3)}, n), sample);
  EXPECT_NE(points(DesignKind::kLatinHypercube, {range("a", 0, 1), range("b", -2, 3)}, n, {}, 2),
            sample);
}

// Joe and Kuo's sequence without the origin: 1/2, then (3/4, 1/4), (1/4, 3/4) ...
TEST(SweepDesign, SobolsFirstPointsAreTheKnownOnesAndMorePointsKeepThem) {
  const auto sample = points(DesignKind::kSobol, {range("a", 0, 1), range("b", 0, 1)}, 4);
  EXPECT_THAT(sample, ElementsAre(DesignPoint{"0.5", "0.5"}, DesignPoint{"0.75", "0.25"},
                                  DesignPoint{"0.25", "0.75"}, DesignPoint{"0.375", "0.375"}));
  const auto more = points(DesignKind::kSobol, {range("a", 0, 1), range("b", 0, 1)}, 100);
  EXPECT_TRUE(std::equal(sample.begin(), sample.end(), more.begin()));
}

// With the origin, the first 2^m points have one in each of 2^m equal parts of each factor.
TEST(SweepDesign, SobolIsStratified) {
  const auto sample =
      points(DesignKind::kSobol, {range("a", 0, 64), range("b", 0, 64), range("c", 0, 64)}, 63);
  for (std::size_t k = 0; k < 3; ++k) {
    std::set<int> parts = {0};
    for (const DesignPoint& p : sample) parts.insert(static_cast<int>(std::stod(p[k])));
    EXPECT_EQ(parts.size(), 64u) << k;
  }
}

TEST(SweepDesign, SampledListsTakeEachValueEquallyOftenAndWholeNumbersAreWhole) {
  Factor seed = range("seed", 1, 9);
  seed.whole = true;
  const auto sample = points(DesignKind::kLatinHypercube, {list("bur", {"a", "b", "c"}), seed}, 30);
  for (const char* bur : {"a", "b", "c"})
    EXPECT_EQ(std::count_if(sample.begin(), sample.end(),
                            [&](const DesignPoint& p) { return p[0] == bur; }),
              10);
  for (const DesignPoint& p : sample) EXPECT_EQ(p[1].find('.'), std::string::npos) << p[1];
}

TEST(SweepDesign, ConstraintsCompareNumbersAsNumbersAndTextsAsTexts) {
  const std::vector<Factor> factors = {list("depth", {"0.5", "1", "10"}),
                                       list("most", {"2", "1.0"}), list("bur", {"a", "b"})};
  const auto count = [&](std::vector<std::string> where) {
    return points(DesignKind::kGrid, factors, 0, std::move(where)).size();
  };
  EXPECT_EQ(count({}), 12u);
  EXPECT_EQ(count({"depth < 10"}), 8u);  // as texts "10" would stand before "2"
  EXPECT_EQ(count({"depth == most"}), 2u);
  EXPECT_EQ(count({"depth <= most"}), 8u);
  EXPECT_EQ(count({"depth<=most", "bur != a"}), 4u);
  EXPECT_EQ(count({"2 > depth"}), 8u);
  EXPECT_EQ(count({"bur == b", "depth >= 1"}), 4u);
  EXPECT_THROW(count({"bur < b"}), Error);
  EXPECT_THROW(count({"depth > 100"}), Error) << "no point is left";
  for (const char* bad : {"depth", "depth = 1", "depth <", "< 2", "depth <> 2"})
    EXPECT_THROW(parse_constraint(bad), Error) << bad;
}

TEST(SweepDesign, TooManyPointsAreRefusedBeforeTheyAreMade) {
  EXPECT_THROW(points(DesignKind::kGrid, {range("a", 0, 1, 10000), range("b", 0, 1, 10000)}),
               Error);
}

}  // namespace
}  // namespace toothprep
