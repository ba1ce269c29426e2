// Where a bur was that moved straight on, against bodies whose sweeps are known.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/grinding/straight_sweep.h"

namespace toothprep::testing {
namespace {

const Quat kTurned(Eigen::AngleAxisd(0.7, Vec3(1, 2, -1).normalized()));

// How far a place lies inside of a ball of radius 0.6 that went along a way, which is a capsule.
double inside_capsule(const Vec3& place, const Vec3& from, const Vec3& way) {
  const double t = std::clamp(way.dot(place - from) / way.squaredNorm(), 0.0, 1.0);
  return 0.6 - (place - from - t * way).norm();
}

TEST(StraightWay, OfABallIsACapsule) {
  const Bur bur = make_bur("ball:D1.2", "");
  const StraightSweep sweep{Pose{Vec3(3, -2, 5), kTurned}, Vec3(1.5, 0.4, -0.3)};
  // Beside and below the ball's middle, where its shank isn't.
  std::mt19937 numbers(1);
  std::uniform_real_distribution<double> any(-1, 1);
  int inside = 0, outside = 0;
  for (int n = 0; n < 4000; ++n) {
    const Vec3 at = sweep.from.to_world(Vec3(any(numbers), any(numbers), 0.6 * any(numbers))) +
                    0.5 * (1 + any(numbers)) * sweep.way;
    const double depth = inside_capsule(at, sweep.from.to_world(Vec3(0, 0, 0.6)), sweep.way) - 0.01;
    if (std::abs(depth) < 1e-6) continue;
    const Vec3 above = sweep.from.to_local(at) - sweep.from.orientation.conjugate() * sweep.way;
    if (sweep.from.to_local(at).z() > 0.6 || above.z() > 0.6) continue;
    EXPECT_EQ(sweep.was_over(bur, at, 0.01), depth > 0) << at.transpose();
    ++(depth > 0 ? inside : outside);
  }
  EXPECT_GT(inside, 500);
  EXPECT_GT(outside, 500);
}

TEST(StraightWay, LeadsToWhereItsBurGoesOn) {
  const Bur bur = make_bur("ball:D1.2", "");
  const StraightSweep sweep{Pose{Vec3(1, 2, 3), kTurned}, Vec3(2, 0, 0)};
  const auto leads = [&](const Vec3& to, const Vec3& direction, const Quat& q = kTurned) {
    return sweep.leads_to(bur, {to, q}, direction, 0.01);
  };
  EXPECT_TRUE(leads({3, 2, 3}, {1, 0, 0}));
  EXPECT_TRUE(leads({3.5, 2.005, 3}, {1, 0, 0}));
  EXPECT_FALSE(leads({2.5, 2, 3}, {1, 0, 0})) << "on its way";
  EXPECT_FALSE(leads({3.5, 2.02, 3}, {1, 0, 0})) << "beside it";
  EXPECT_FALSE(leads({3, 2, 3}, {-1, 0, 0})) << "back";
  EXPECT_FALSE(leads({3, 2, 3}, {0, 1, 0})) << "around a corner";
  EXPECT_FALSE(leads({3, 2, 3}, {1, 0, 0}, Quat::Identity())) << "with another lean";
}

TEST(StraightWay, FollowsThatFromWhichItGoesOnWithHardlyABend) {
  const StraightSweep before{Pose{Vec3(1, 2, 3), kTurned}, Vec3(0.2, 0, 0)};
  const auto follows = [&](const Vec3& way, bool goes_on = true) {
    return StraightSweep{Pose{Vec3(1.2, 2, 3), kTurned}, way, 0, goes_on}.follows(before);
  };
  EXPECT_TRUE(follows({0.1, 0, 0}));
  EXPECT_TRUE(follows({0.1, 0.018, 0}));
  EXPECT_FALSE(follows({0.1, 0.022, 0})) << "around a corner";
  EXPECT_FALSE(follows({-0.1, 0, 0})) << "back";
  EXPECT_FALSE(follows({0.1, 0, 0}, false)) << "from elsewhere";
}

// A cylinder fed along its own axis, and across it.
TEST(StraightWay, OfACylinderIsAsLongAndAsWideAsItsWay) {
  const Bur bur = make_bur("cylinder:D1.2xL3.0", "");
  const Pose from{Vec3(1, 2, 3), kTurned};
  const StraightSweep down{from, kTurned * Vec3(0, 0, -0.4)}, across{from, kTurned * Vec3(2, 0, 0)};
  const auto over = [&](const StraightSweep& sweep, double x, double y, double z) {
    return sweep.was_over(bur, from.to_world(Vec3(x, y, z)), 1e-4);
  };
  EXPECT_TRUE(over(down, 0.59, 0, -0.399));
  EXPECT_FALSE(over(down, 0.59, 0, -0.401));
  EXPECT_FALSE(over(down, 0.601, 0, -0.2));
  EXPECT_TRUE(over(across, 2.599, 0, 1));
  EXPECT_FALSE(over(across, 2.601, 0, 1));
  EXPECT_TRUE(over(across, 1.1, 0.599, 0.001));
  EXPECT_FALSE(over(across, 1.1, 0.601, 0.001));
  EXPECT_FALSE(over(across, 1.1, 0.599, -0.001));
}

TEST(StraightWay, LeadsOnWhileItIsStraight) {
  const Bur bur = make_bur("cylinder:D1.2xL3.0", "");
  const Pose start{Vec3(1, 2, 3), kTurned};
  const auto at = [&](double x, double y) { return Pose{start.position + Vec3(x, y, 0), kTurned}; };
  const auto turned = [&](double x, double angle, const Vec3& axis) {
    return Pose{at(x, 0).position, start.orientation * Quat(Eigen::AngleAxisd(angle, axis))};
  };
  StraightSweep sweep{start, Vec3(0.1, 0, 0)};
  constexpr double kAside = 1e-4;
  const auto length = [&] { return sweep.way.norm(); };
  EXPECT_TRUE(sweep.lead_on(bur, at(0.2, 0), kAside));
  EXPECT_NEAR(length(), 0.2, 1e-12);
  EXPECT_FALSE(sweep.lead_on(bur, at(0.15, 0), kAside));  // it turns back
  EXPECT_FALSE(sweep.lead_on(bur, at(0.3, 0.01), kAside));
  EXPECT_FALSE(sweep.lead_on(bur, turned(0.3, 1e-4, Vec3::UnitX()), kAside));
  EXPECT_NEAR(length(), 0.2, 1e-12);
  EXPECT_TRUE(sweep.lead_on(bur, turned(0.3, 1.0, Vec3::UnitZ()), kAside));  // about its axis
  EXPECT_NEAR(length(), 0.3, 1e-12);
  // What it is off the line adds up.
  int steps = 0;
  for (double x = 0.4, y = 1e-5; sweep.lead_on(bur, at(x, y), kAside);
       x += 0.1, ++steps, y += 1e-5 * steps) {
    EXPECT_LE(sweep.aside, kAside);
    ASSERT_LT(steps, 100);
  }
  EXPECT_GT(steps, 2);
}

TEST(StraightWay, IsRetracedEitherWayAsFarAsItGoes) {
  const Bur bur = make_bur("cylinder:D1.2xL3.0", "");
  const StraightSweep sweep{Pose{Vec3(1, 2, 3), kTurned}, Vec3(2, 0, 0)};
  const auto retraced = [&](const Vec3& off, const Vec3& v, double lean = 0) {
    const Quat q = kTurned * Quat(Eigen::AngleAxisd(lean, Vec3::UnitX()));
    return sweep.leads_through(bur, {sweep.from.position + off, q}, v, 0.005);
  };
  EXPECT_TRUE(retraced(Vec3(1.5, 0.004, 0), Vec3(-8, 0, 0)));
  EXPECT_TRUE(retraced(Vec3(0, 0, 0.001), Vec3(0.1, 0, 0)));
  EXPECT_FALSE(retraced(Vec3(1.5, 0.006, 0), Vec3(-8, 0, 0)));
  EXPECT_FALSE(retraced(Vec3(1.5, 0, 0), Vec3(-8, 1, 0)));
  EXPECT_FALSE(retraced(Vec3(1.5, 0, 0), Vec3(-8, 0, 0), 0.01));
  EXPECT_FALSE(retraced(Vec3(1.5, 0, 0), Vec3::Zero()));
  EXPECT_FALSE(retraced(Vec3(2, 0, 0), Vec3(8, 0, 0)));  // it goes on where it ended
  EXPECT_FALSE(retraced(Vec3(2.1, 0, 0), Vec3(8, 0, 0)));
  EXPECT_FALSE(retraced(Vec3(0.004, 0, 0), Vec3(-8, 0, 0)));
}

}  // namespace
}  // namespace toothprep::testing
