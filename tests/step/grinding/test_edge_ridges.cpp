// Ridges of a swept edge against the triangle that its two faces and the step enclose.
#include <gtest/gtest.h>

#include <cmath>

#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/grinding/edge_ridges.h"

namespace toothprep {
namespace {

TEST(EdgeRidges, AFlatEndThatLeansAlongItsFeedLeavesThoseOfARightAngle) {
  const EdgeRidges ridges(make_bur("cylinder:D1.2xL3.0", ""));
  for (const double leant : {-0.3, 0.05, 0.16, 0.7}) {
    const Vec3 along(std::cos(leant), 0, std::sin(leant));
    EXPECT_NEAR(ridges.height_per_step(along), std::abs(std::sin(leant) * std::cos(leant)), 1e-12);
  }
}

TEST(EdgeRidges, ThereAreNoneWhereNoEdgeIsLastToTouch) {
  const EdgeRidges cylinder(make_bur("cylinder:D1.2xL3.0", "")), ball(make_bur("ball:D1.2", ""));
  EXPECT_EQ(cylinder.height_per_step(Vec3(1, 0, 0)), 0);   // sideways
  EXPECT_EQ(cylinder.height_per_step(Vec3(0, 0, -1)), 0);  // plunged
  EXPECT_EQ(ball.height_per_step(Vec3(0.8, 0, 0.6)), 0);
}

TEST(EdgeRidges, AnInvertedConeThatIsPlungedLeavesThemOnItsUndercutWall) {
  const double angle = 8 * 3.14159265358979 / 180;
  const EdgeRidges ridges(make_bur("inverted-cone:D1.2xL1.6xA8", ""));
  // The motion runs square to the flat end, and by `angle` past the side.
  EXPECT_NEAR(ridges.height_per_step(Vec3(0, 0, -1)), std::sin(angle) / std::cos(angle), 1e-9);
}

}  // namespace
}  // namespace toothprep
