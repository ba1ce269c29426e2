#include <gtest/gtest.h>

#include "toothprep/tools/display/duration_counts.h"

namespace toothprep::testing {
namespace {

// 1, 2 .. 1000 ms: the q-quantile is q seconds, and a bin is 2 % wide.
TEST(DurationCounts, QuantilesAreGoodToTwoPercent) {
  DurationCounts counts;
  EXPECT_EQ(counts.quantile(0.5), 0);
  for (int ms = 1; ms <= 1000; ++ms) counts.add(1e-3 * ms);
  EXPECT_EQ(counts.count(), 1000u);
  EXPECT_NEAR(counts.quantile(0.5), 0.5, 0.0101);
  EXPECT_NEAR(counts.quantile(0.99), 0.99, 0.02);
  EXPECT_EQ(counts.quantile(1), 1.0);
  EXPECT_EQ(counts.largest(), 1.0);
}

TEST(DurationCounts, WhatIsOutOfRangeIsCountedAtTheEnds) {
  DurationCounts counts;
  counts.add(0);
  counts.add(-1);  // a clock read on two cores
  counts.add(1e9);
  EXPECT_EQ(counts.count(), 3u);
  EXPECT_LE(counts.quantile(0.3), 1e-6);
  EXPECT_EQ(counts.largest(), 1e9);
}

}  // namespace
}  // namespace toothprep::testing
