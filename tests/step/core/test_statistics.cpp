#include <gtest/gtest.h>

#include "toothprep/step/core/statistics.h"

namespace toothprep {
namespace {

// Of 1..10 three values don't exceed 3, so 3 is the quantile of every share above 0.2 up to 0.3.
TEST(Statistics, AQuantileIsTheSmallestValueThatTheShareDoesNotExceed) {
  const std::vector<double> values = {4, 8, 1, 10, 3, 7, 2, 9, 6, 5};
  EXPECT_EQ(quantile(values, 0.3), 3);
  EXPECT_EQ(quantile(values, 0.21), 3);
  EXPECT_EQ(quantile(values, 0), 1);
  EXPECT_EQ(quantile(values, 1), 10);
  EXPECT_EQ(quantile(std::vector<double>{7}, 0.5), 7);
}

TEST(Statistics, TheMedianOfAnEvenCountIsTheUpperOfTheTwoInTheMiddle) {
  EXPECT_EQ(median(std::vector<int>{3, 1, 2}), 2);
  EXPECT_EQ(median(std::vector<int>{4, 1, 3, 2}), 3);
}

// Equal weights make it the plain quantile; a weight counts as often as it says.
TEST(Statistics, AWeightedQuantileCountsWeightInsteadOfValues) {
  std::vector<WeightedValue> equal;
  for (const double v : {4, 8, 1, 10, 3, 7, 2, 9, 6, 5}) equal.push_back({v, 0.1});
  for (const double share : {0.0, 0.3, 0.31, 0.95, 1.0}) {
    std::vector<double> values;
    for (const WeightedValue& v : equal) values.push_back(v.value);
    EXPECT_EQ(weighted_quantile(equal, share), quantile(values, share)) << share;
  }
  const std::vector<WeightedValue> heavy = {{5, 1}, {1, 9}};
  EXPECT_EQ(weighted_quantile(heavy, 0.9), 1);
  EXPECT_EQ(weighted_quantile(heavy, 0.91), 5);
}

}  // namespace
}  // namespace toothprep
