#include <gtest/gtest.h>

#include <cmath>

#include "toothprep/step/core/number_text.h"

namespace toothprep {
namespace {

TEST(NumberText, TheShortestTextReadsBackAsTheSameNumber) {
  for (const double x :
       {0.1, 1e5, 123456789.0, 1.0 / 3, 2.2250738585072014e-308, 1.7976931348623157e308})
    EXPECT_EQ(std::stod(shortest_text(x)), x);
  EXPECT_EQ(shortest_text(0.1), "0.1");
  EXPECT_EQ(shortest_text(0.1f), "0.1");  // of a float, not of the double it turns into
  EXPECT_EQ(shortest_text(1e5), "1e+05");
}

TEST(NumberText, OnlyZeroLosesItsMinus) {
  EXPECT_EQ(without_negative_zero("-0.00"), "0.00");
  EXPECT_EQ(without_negative_zero("-0.0 mm"), "0.0 mm");
  EXPECT_EQ(without_negative_zero("-0.01"), "-0.01");
  EXPECT_EQ(without_negative_zero("-10"), "-10");
  EXPECT_EQ(without_negative_zero(""), "");
}

}  // namespace
}  // namespace toothprep
