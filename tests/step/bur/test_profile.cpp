// What an outline must satisfy, and the names of the conditions it violates.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "bur_cases.h"
#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;
using Outline = std::vector<ProfilePiece>;

std::string refusal(const Outline& outline, double shank_radius = 0, double shank_top = 0) {
  try {
    Bur("b", outline, shank_radius, shank_top);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

Outline cylinder(double radius, double length) {
  return {line_piece(0, 0, radius, 0), line_piece(radius, 0, radius, length),
          line_piece(radius, length, 0, length, false)};
}

TEST(Outline, OfACylinderIsAccepted) { EXPECT_EQ(refusal(cylinder(0.6, 3)), ""); }

TEST(Outline, NamesTheViolatedCondition) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double inf = std::numeric_limits<double>::infinity();
  const struct {
    Outline outline;
    const char* condition;
  } cases[] = {
      {{}, "has no pieces"},
      {{line_piece(0, 0.1, 0.6, 0.1), line_piece(0.6, 0.1, 0, 3)}, "must start at the tip (0, 0)"},
      {{line_piece(0, 0, 0.6, 0), line_piece(0.6, 0.01, 0, 3)}, "a gap of 0.01 mm"},
      {{line_piece(0, 0, 0.6, 0), line_piece(0.6, 0, 0.6, 3)}, "must end on the axis"},
      {{line_piece(0, 0, 0.6, 0), line_piece(0.6, 0, -0.1, 2), line_piece(-0.1, 2, 0, 3)},
       "r must not be negative"},
      {{line_piece(0, 0, 0.6, -0.2), line_piece(0.6, -0.2, 0, 3)},
       "the tip at z = 0 must be the lowest"},
      {{line_piece(0, 0, 0.6, 0), line_piece(0.6, 0, 0, 1), line_piece(0, 1, 0.6, 2),
        line_piece(0.6, 2, 0, 3)},
       "only the last piece may"},
      {cylinder(10.5, 3), "above the limit of 10 mm"},
      {cylinder(0.6, 51), "above the limit of 50 mm"},
      {cylinder(nan, 3), "not finite"},
      {cylinder(0.6, inf), "not finite"},
      {{line_piece(0, 0, 0.6, 0), line_piece(0.6, 0, 0.6, 0), line_piece(0.6, 0, 0, 3)},
       "has no length"},
      {{line_piece(0, 0, 0, 3)}, "encloses no area"},
      // up along the axis' neighbourhood first, down the outside: clockwise
      {{line_piece(0, 0, 0.2, 3), line_piece(0.2, 3, 0.6, 1), line_piece(0.6, 1, 0, 0.5)},
       "crosses or touches piece 1"},
      {{line_piece(0, 0, 1, 0), line_piece(1, 0, 0.2, 2), line_piece(0.2, 2, 1, 2),
        line_piece(1, 2, 0.2, 0.5), line_piece(0.2, 0.5, 0, 3)},
       "crosses or touches"},
      {{line_piece(0, 0, 1, 0), line_piece(1, 0, 0.5, 0), line_piece(0.5, 0, 0, 3)}, "folds back"},
      {{line_piece(0, 0, 0.6, 0), arc_piece(0.6, 0, 0.6, 2, 0.3, 0.9), line_piece(0.6, 2, 0, 2)},
       "not equally far from its two ends"},
      // an arc that bulges through the piece after next
      {{line_piece(0, 0, 0.2, 0), arc_piece(0.2, 0, 0.2, 1, 0.2, 0.5), line_piece(0.2, 1, 1, 0.5),
        line_piece(1, 0.5, 1, 2), line_piece(1, 2, 0, 2)},
       "crosses or touches"},
      {{arc_piece(0, 0, 0, 3, 0, 1.5), line_piece(0, 3, 0, 4)}, "only the last piece may"},
      {{arc_piece(0, 0, 0, 2, 0, 1, false)}, "r must not be negative"},
      {cylinder(0.001, 0.003), "are the coordinates in mm?"},
      {{line_piece(0, 0, 0.6, 0, false), line_piece(0.6, 0, 0, 3, false)}, "no piece grinds"},
  };
  for (const auto& c : cases) EXPECT_THAT(refusal(c.outline), HasSubstr(c.condition));
}

TEST(Outline, JointsWithinAMicrometreThousandthAreMadeExact) {
  const Bur bur("b",
                {line_piece(0, 0, 0.6, 0), line_piece(0.6 + 5e-7, 0, 0.6, 3 - 4e-7),
                 line_piece(0.6, 3, 3e-7, 3, false)},
                0, 0);
  const auto& p = bur.profile();
  EXPECT_EQ(p[1].r0, p[0].r1);
  EXPECT_EQ(p[2].z0, p[1].z1);
  EXPECT_EQ(p[2].r1, 0.0);
}

TEST(Outline, ACentreWithThreeDecimalsIsMovedOntoTheBisector) {
  // 60 degrees of radius 0.5 about (0.1, 0.5) from straight below; the end rounded to 3 decimals.
  const double r1 = std::round((0.1 + 0.5 * std::sin(units::kPi / 3)) * 1e3) / 1e3, z1 = 0.25;
  const Bur bur("b",
                {line_piece(0, 0, 0.1, 0), arc_piece(0.1, 0, r1, z1, 0.1, 0.5),
                 line_piece(r1, z1, r1, 2), line_piece(r1, 2, 0, 2, false)},
                0, 0);
  const ProfilePiece& arc = bur.profile()[1];
  EXPECT_NEAR(std::hypot(arc.r0 - arc.centre_r, arc.z0 - arc.centre_z),
              std::hypot(arc.r1 - arc.centre_r, arc.z1 - arc.centre_z), 1e-14);
  EXPECT_NEAR(std::hypot(arc.centre_r - 0.1, arc.centre_z - 0.5), 0, 1e-3);
}

TEST(Shank, MustStandAboveTheHead) {
  EXPECT_EQ(refusal(cylinder(0.6, 3), 0.5, 9), "");
  EXPECT_THAT(refusal(cylinder(0.6, 3), 0.5, 3), HasSubstr("must lie above the head"));
  EXPECT_THAT(refusal(cylinder(0.6, 3), 0.5, 60), HasSubstr("not above 50 mm"));
  EXPECT_THAT(refusal(cylinder(0.6, 3), -0.5, 9), HasSubstr("radius must be within"));
  EXPECT_THAT(refusal(cylinder(0.6, 3), std::nan(""), 9), HasSubstr("radius must be within"));
}

}  // namespace
}  // namespace toothprep
