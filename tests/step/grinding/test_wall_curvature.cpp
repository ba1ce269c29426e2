// Curvature of swept walls against the bur's outline.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/grinding/wall_curvature.h"

namespace toothprep::testing {
namespace {

// How far (mm) the head reaches in a direction with this part along its axis.
double reach_of(const std::vector<ProfilePiece>& outline, double along_axis, int points = 20000) {
  const double across = std::sqrt(std::max(0.0, 1 - along_axis * along_axis));
  double most = -1e9;
  for (const ProfilePiece& piece : outline)
    for (int i = 0; i <= points; ++i) {
      const ProfilePoint at = point_on(piece, static_cast<double>(i) / points);
      most = std::max(most, at.r * across + at.z * along_axis);
    }
  return most;
}

// A convex outline's radius of curvature is what it reaches in its normal's direction and the second derivative of that
// by the direction's angle.
TEST(WallCurvature, IsThatOfTheHeadsOutlineAcrossTheMotion) {
  constexpr double kStep = 0.02;  // rad
  constexpr float kValue = 0.02f;
  for (const char* spec : {"ball:D1.2", "taper:D1.4xL4.0xA4", "cylinder:D1.2xL4.0xR0.3"}) {
    const Bur bur = make_bur(spec, "");
    const WallCurvature walls(bur.profile());
    for (const double lean : {0.0, 0.1, -0.4}) {
      const auto reach = [&](double angle) {
        return reach_of(bur.profile(), std::sin(angle) * std::cos(lean));
      };
      for (const double angle : {-1.3, -1.0, -0.6, -0.2}) {
        const Float4 normal = all4(static_cast<float>(std::sin(angle) * std::cos(lean)));
        ASSERT_TRUE(any(walls.know(normal))) << spec << " " << lean << " " << angle;
        const double radius =
            reach(angle) +
            (reach(angle + kStep) - 2 * reach(angle) + reach(angle - kStep)) / (kStep * kStep);
        const auto motion = static_cast<float>(std::sin(lean));
        const Float4 curvature =
            walls.arc(normal).curvature({all4(kValue), normal, Float4{}, all4(motion)});
        EXPECT_NEAR(1 / static_cast<double>(curvature[0]), radius - kValue, 2e-3)
            << spec << " " << lean << " " << angle;
      }
    }
  }
}

// Of a place in a swept head's void the depth is the least, over all directions across the motion, of how much farther
// the head reaches than the place.
TEST(WallCurvature, TellsTheFieldBesideAPlaceWhoseNormalIsKnown) {
  constexpr double kPi = 3.14159265358979;
  for (const char* spec : {"ball:D1.2", "taper:D1.4xL4.0xA4", "cylinder:D1.2xL4.0xR0.3"}) {
    const Bur bur = make_bur(spec, "");
    const WallCurvature walls(bur.profile());
    for (const double lean : {0.0, 0.012, 0.05, 0.15, -0.4})
      for (const double angle : {-1.4, -1.2, -1.0, -0.6}) {
        const auto reach = [&](double at, int points = 20000) {
          return reach_of(bur.profile(), std::sin(at) * std::cos(lean), points);
        };
        // In the plane across the motion, by this angle's direction and that square to it.
        constexpr double kStep = 1e-3, kDepth = 0.02;
        const double out = reach(angle) - kDepth,
                     aside = (reach(angle + kStep) - reach(angle - kStep)) / (2 * kStep);
        for (const double way : {-0.2, -0.12, 0.08}) {
          constexpr double kOut = 0.015;
          double least = 1e9, turned = 0;
          const auto look = [&](double from, double to, double step) {
            for (double turn = from; turn < to; turn += step) {
              const double depth = reach(angle + turn, 1000) - (out + kOut) * std::cos(turn) -
                                   (aside + way) * std::sin(turn);
              if (depth < least) least = depth, turned = turn;
            }
          };
          look(-kPi / 3, kPi / 3, 1e-2);
          look(turned - 1e-2, turned + 1e-2, 1e-4);
          const auto four = [](double x) { return all4(static_cast<float>(x)); };
          const SweptArc::Known known{four(kDepth), four(std::sin(angle) * std::cos(lean)),
                                      four(std::cos(angle) * std::cos(lean)), four(std::sin(lean))};
          const SweptArc::Tangent t = walls.arc(known.normal).at(known, four(kOut), four(way));
          EXPECT_NEAR(static_cast<double>(t.value[0]), least, 2e-5)
              << spec << " " << lean << " " << angle << " " << way;
          EXPECT_NEAR(static_cast<double>(t.sine[0]), std::sin(turned), 4e-3)
              << spec << " " << lean << " " << angle << " " << way;
        }
      }
  }
}

// Upright, a flat end leaves a plane floor; a lattice's gradient there is off by some thousandths.
TEST(WallCurvature, OfAFlatEndsFloorIsNone) {
  const WallCurvature walls(make_bur("cylinder:D1.2xL4.0xR0.3", "").profile());
  constexpr float kValue = 2e-4f, kOut = -0.008f;
  for (const float aside : {0.0f, 0.004f, -0.03f}) {
    const SweptArc::Known floor{all4(kValue), all4(-std::sqrt(1 - aside * aside)), all4(aside),
                                Float4{}};
    ASSERT_TRUE(any(walls.know(floor.normal)));
    const SweptArc arc = walls.arc(floor.normal);
    EXPECT_EQ(arc.curvature(floor)[0], 0) << aside;
    for (const float beside : {0.0f, 3e-5f, 0.02f}) {
      const SweptArc::Tangent t = arc.at(floor, all4(kOut), all4(beside));
      EXPECT_EQ(t.value[0], kValue - kOut) << aside << " " << beside;
      EXPECT_EQ(t.sine[0], 0) << aside << " " << beside;
    }
  }
}

// An edge leaves walls of any normal between those of the parts that meet there.
TEST(WallCurvature, IsNotKnownOfSharpEndsNorBesideTheShanksEnd) {
  const auto knows = [](const char* spec, float normal) {
    return any(WallCurvature(make_bur(spec, "").profile()).know(all4(normal)));
  };
  for (const float normal : {-1.0f, -0.5f, 0.0f, 0.5f}) {
    EXPECT_FALSE(knows("cylinder:D1.2xL3.0", normal)) << normal;
    EXPECT_FALSE(knows("inverted-cone:D1.2xL1.6xA8", normal)) << normal;
    EXPECT_TRUE(knows("ball:D1.2", normal)) << normal;
  }
  EXPECT_FALSE(knows("taper:D1.4xL4.0xA4", 0.3f));
  EXPECT_FALSE(knows("cylinder:D1.2xL4.0xR0.3", 0));
}

}  // namespace
}  // namespace toothprep::testing
