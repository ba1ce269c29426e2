#include <gtest/gtest.h>

#include "toothprep/tools/mesh/diverging_colour.h"

namespace toothprep {
namespace {

using Srgb = std::array<float, 3>;

TEST(DivergingColour, IsBlueBelowWhiteAtZeroAndRedAbove) {
  EXPECT_EQ(diverging_srgb(-1), (Srgb{33, 102, 172}));
  EXPECT_EQ(diverging_srgb(0), (Srgb{247, 247, 247}));
  EXPECT_EQ(diverging_srgb(1), (Srgb{178, 24, 43}));
}

TEST(DivergingColour, IsTheEndsBeyondTheEnds) {
  EXPECT_EQ(diverging_srgb(-7), diverging_srgb(-1));
  EXPECT_EQ(diverging_srgb(7), diverging_srgb(1));
}

TEST(DivergingColour, GoesEvenlyFromOneClassToTheNext) {
  EXPECT_EQ(diverging_srgb(0.125f), (Srgb{250, 233, 223}));  // half-way from white to the next
}

}  // namespace
}  // namespace toothprep
