// The closed forms: the figures that the paper's values give, and the operating points of a turbine
// that droops.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "toothprep/proof/reference/closed_forms.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep::reference {
namespace {

using units::kPi;

constexpr Grinding kEnamel{300, 0.25, 100}, kDentin{100, 0.25, 100};
constexpr double kRound = 1e-13;  // relative: a few roundings

TEST(ClosedForms, PlateausOfThePapersBurs) {
  // u v L / (4 alpha N) = 300·0.5·3 / (4·0.25·100) = 4.5, and so on by hand.
  const SteadyLoad cylinder = cylinder_side_feed(kEnamel, 0.6, 3, 0.5);
  EXPECT_NEAR(cylinder.against, 4.5, 4.5 * kRound);
  EXPECT_NEAR(cylinder.across, 1.125, kRound);
  EXPECT_NEAR(cylinder.torque, 2.7 / kPi, kRound);
  const SteadyLoad ball = ball_side_feed(kEnamel, 0.6, 0.5);
  EXPECT_NEAR(ball.against, 0.45 * kPi, kRound * 2);
  EXPECT_NEAR(ball.across, 0.45, kRound);
  EXPECT_NEAR(ball.torque, 0.27, kRound);
  const SteadyLoad plunge = flat_end_plunge(kEnamel, 0.6, 0.5);
  EXPECT_NEAR(plunge.against, 3.6, kRound * 4);
  EXPECT_EQ(plunge.across, 0);
  EXPECT_NEAR(plunge.torque, 0.27, kRound);
}

TEST(ClosedForms, DentinTakesAThirdOfEnamel) {
  EXPECT_NEAR(cylinder_side_feed(kDentin, 0.6, 3, 0.5).against, 1.5, 2 * kRound);
  EXPECT_NEAR(ball_side_feed(kDentin, 0.6, 0.5).torque, 0.09, kRound);
}

TEST(ClosedForms, LoadAtTheStallIsThatOfTheStallSpeed) {
  const double speed = cylinder_stall_speed(kEnamel, 0.6, 3, 1.2);
  EXPECT_NEAR(speed, 1.2 * kPi * 100 / 540, kRound);  // 0.698 mm/s
  const SteadyLoad there = cylinder_side_feed(kEnamel, 0.6, 3, speed);
  const SteadyLoad direct = cylinder_at_stall(0.25, 0.6, 1.2);
  EXPECT_NEAR(there.torque, 1.2, 2 * kRound);
  EXPECT_NEAR(direct.against, there.against, 10 * kRound);
  EXPECT_NEAR(direct.across, there.across, 2 * kRound);
  EXPECT_NEAR(direct.against, 2 * kPi, 10 * kRound);
}

TEST(ClosedForms, DroopUnderImposedFeedBalancesPower) {
  const double n0 = 5000, tau = 1.0, most = droop_greatest_power(n0, tau);
  EXPECT_NEAR(most, kPi * 2500, 1e-9);
  for (const double share : {0.0, 1e-9, 0.1, 0.5, 0.9, 1.0}) {
    const auto point = droop_imposed_feed(n0, tau, share * most);
    ASSERT_TRUE(point);
    // The turbine's line and the balance of power, by which the form was derived.
    EXPECT_NEAR(point->rotation_rate, n0 * (1 - point->torque / tau), 1e-9);
    EXPECT_NEAR(2 * kPi * point->rotation_rate * point->torque, share * most, most * share * 1e-12);
    EXPECT_LE(point->torque, tau / 2 + kRound);  // the stable branch
  }
  EXPECT_NEAR(droop_imposed_feed(n0, tau, most)->torque, tau / 2, 1e-7);  // a double root
  EXPECT_FALSE(droop_imposed_feed(n0, tau, most * 1.0001));
}

TEST(ClosedForms, DroopUnderImposedForceFeedsFastestAtHalfTheStallTorque) {
  const Grinding g{6700, 0.25, 5000};
  const double tau = 1.0, radius = 0.6, length = 3;
  const double at_stall = cylinder_at_stall(g.force_ratio, radius, tau).against;
  const auto speed = [&](double share) {
    const auto feed = droop_cylinder_under_force(g, tau, radius, length, share * at_stall);
    return feed ? feed->speed : 0.0;
  };
  const double half = speed(0.5);
  for (const double share : {0.1, 0.3, 0.49, 0.51, 0.7, 0.9}) {
    EXPECT_LT(speed(share), half);
    // v goes as T (1 - T / tau).
    EXPECT_NEAR(speed(share), half * 4 * share * (1 - share), half * 1e-12);
  }
  // The same load from the law at the rate that the turbine then runs at.
  const auto feed = droop_cylinder_under_force(g, tau, radius, length, 0.3 * at_stall);
  const SteadyLoad load =
      cylinder_side_feed({6700, 0.25, feed->point.rotation_rate}, radius, length, feed->speed);
  EXPECT_NEAR(load.against, 0.3 * at_stall, 1e-12 * at_stall);
  EXPECT_NEAR(load.torque, feed->point.torque, 1e-12);
  EXPECT_FALSE(droop_cylinder_under_force(g, tau, radius, length, 1.0001 * at_stall));
}

TEST(ClosedForms, RefuseWhatIsNotPositive) {
  EXPECT_THROW(static_cast<void>(cylinder_side_feed({300, 0, 100}, 0.6, 3, 0.5)), Error);
  EXPECT_THROW(static_cast<void>(cylinder_side_feed({300, 0.25, 0}, 0.6, 3, 0.5)), Error);
  EXPECT_THROW(static_cast<void>(ball_side_feed(kEnamel, -0.6, 0.5)), Error);
  EXPECT_THROW(static_cast<void>(flat_end_plunge(kEnamel, 0.6, std::nan(""))), Error);
  EXPECT_THROW(static_cast<void>(cylinder_stall_speed({0, 0.25, 100}, 0.6, 3, 1.2)), Error);
  EXPECT_THROW(
      static_cast<void>(droop_imposed_feed(5000, std::numeric_limits<double>::infinity(), 1)),
      Error);
}

}  // namespace
}  // namespace toothprep::reference
