// What the governor lets through, against its own laws in closed form.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/live_tick.h"
#include "toothprep/tools/live/force_governor.h"

namespace toothprep {
namespace {

ForceLimits bare() {
  ForceLimits limits;
  limits.max_force = 8;
  limits.continuous_force = 1.75;
  limits.max_force_rate = 1e6;
  limits.ramp = 0;
  limits.vibration_limit = std::numeric_limits<double>::infinity();
  return limits;
}

TEST(ForceGovernor, LetsAnAllowedForceThroughToTheBit) {
  ForceGovernor governor(bare());
  std::uint32_t flags = 0;
  const Vec3 force(0.1, -0.7, 0.3);
  EXPECT_EQ(governor.limit(force, flags), force);
  EXPECT_EQ(flags, 0u);
}

TEST(ForceGovernor, ClampsTheNormAndKeepsTheDirection) {
  ForceGovernor governor(bare());
  std::uint32_t flags = 0;
  const Vec3 out = governor.limit(Vec3(6, 8, 0), flags);
  EXPECT_LT((out - Vec3(4.8, 6.4, 0)).norm(), 1e-12);
  EXPECT_EQ(flags, kForceClamped);
}

TEST(ForceGovernor, TurnsWhatIsNoNumberIntoZero) {
  ForceGovernor governor(bare());
  std::uint32_t flags = 0;
  EXPECT_EQ(governor.limit(Vec3(std::nan(""), 0, 0), flags), Vec3::Zero());
  EXPECT_EQ(flags, kForceNotFinite);
}

TEST(ForceGovernor, ChangesByNoMoreThanTheRateAllows) {
  ForceLimits limits = bare();
  limits.max_force_rate = 500;  // 0.5 N a tick
  ForceGovernor governor(limits);
  for (int n = 1; n <= 6; ++n) {
    std::uint32_t flags = 0;
    EXPECT_NEAR(governor.limit(Vec3(0, 3, 0), flags).y(), 0.5 * n, 1e-12);
    EXPECT_EQ(flags, n < 6 ? kForceRateLimited : 0u);
  }
}

TEST(ForceGovernor, RampsInFromTheStartAndAfterAFault) {
  ForceLimits limits = bare();
  limits.ramp = 0.1;
  ForceGovernor governor(limits);
  for (int round = 0; round < 2; ++round) {
    for (int n = 1; n <= 100; ++n) {
      std::uint32_t flags = 0;
      EXPECT_NEAR(governor.limit(Vec3(1, 0, 0), flags).x(), 0.01 * n, 1e-9);
    }
    governor.restart();
  }
}

TEST(ForceGovernor, TheRampBeginsAfterTheLastTickWithoutAForce) {
  ForceLimits limits = bare();
  limits.ramp = 0.1;
  ForceGovernor governor(limits);
  std::uint32_t flags = 0;
  for (int n = 0; n < 50; ++n) EXPECT_EQ(governor.withhold(flags), Vec3(Vec3::Zero()));
  EXPECT_NEAR(governor.limit(Vec3(1, 0, 0), flags).x(), 0.01, 1e-9);
}

TEST(ForceGovernor, AForceAboveTheLimitIsRampedInNoFaster) {
  ForceLimits limits = bare();
  limits.ramp = 0.1;
  ForceGovernor governor(limits);
  for (int n = 1; n <= 100; ++n) {
    std::uint32_t flags = 0;
    EXPECT_NEAR(governor.limit(Vec3(3 * limits.max_force, 0, 0), flags).x(),
                0.01 * n * limits.max_force, 1e-9);
  }
}

TEST(ForceGovernor, HeatFollowsTheFirstOrderLawAndBringsTheForceDownToTheContinuousOne) {
  const ForceLimits limits = bare();
  ForceGovernor governor(limits);
  const double tau = limits.thermal_time, most = limits.continuous_force * limits.continuous_force;
  const double force = 3;
  // h(t) = F^2 (1 - exp(-t/tau)) reaches 90 % of F_cont^2 at this time; until then nothing happens.
  const double warm = -tau * std::log(1 - 0.9 * most / (force * force));
  std::uint32_t flags = 0;
  int n = 0;
  for (; n < static_cast<int>(1000 * warm) - 1; ++n) governor.limit(Vec3(0, 0, force), flags);
  EXPECT_EQ(flags, 0u);
  EXPECT_NEAR(governor.heat(), 0.9, 1e-3);
  Vec3 out;
  for (; n < 200000; ++n) out = governor.limit(Vec3(0, 0, force), flags);
  EXPECT_EQ(flags, kForceHeatLimited);
  // In the end the force is the one whose heat allows it: between 95 and 100 % of F_cont.
  EXPECT_LE(out.z(), limits.continuous_force * 1.001);
  EXPECT_GE(out.z(), limits.continuous_force * 0.95);
  EXPECT_LE(governor.heat(), 1.0);
}

TEST(ForceGovernor, SwitchesAVibrationOffButNotATouchNorGrinding) {
  ForceLimits limits = bare();
  limits.vibration_limit = 1;
  std::uint32_t flags = 0;
  ForceGovernor touch(limits);
  for (int n = 0; n < 3000; ++n) {
    // Touching with 3 N and letting go, twice a second; 2 N swelling at 2 Hz beside it.
    const double t = 1e-3 * n;
    touch.limit(Vec3(n / 250 % 2 ? 3 : 0, 2 * std::sin(2 * M_PI * 2 * t), 0), flags);
  }
  EXPECT_FALSE(touch.vibrates());
  ForceGovernor limit_cycle(limits);
  int off = -1;
  for (int n = 0; n < 1000 && off < 0; ++n) {
    const Vec3 out = limit_cycle.limit(Vec3(n % 4 < 2 ? 5 : -5, 0, 0), flags = 0);
    if (limit_cycle.vibrates()) {
      off = n;
      EXPECT_EQ(out, Vec3::Zero());
      EXPECT_TRUE(flags & kForceWithheld);
    }
  }
  EXPECT_GT(off, 0);
  EXPECT_LT(off, 80);  // within vibration_time and the window's rise
  EXPECT_EQ(limit_cycle.limit(Vec3(1, 0, 0), flags), Vec3::Zero());  // for good
}

TEST(ForceGovernor, RefusesLimitsThatMakeNoSense) {
  for (double ForceLimits::*member : {&ForceLimits::period, &ForceLimits::max_force,
                                      &ForceLimits::max_force_rate, &ForceLimits::continuous_force,
                                      &ForceLimits::thermal_time, &ForceLimits::vibration_limit}) {
    ForceLimits limits;
    limits.*member = 0;
    EXPECT_THROW(ForceGovernor{limits}, Error);
    limits.*member = std::nan("");
    EXPECT_THROW(ForceGovernor{limits}, Error);
  }
}

}  // namespace
}  // namespace toothprep
