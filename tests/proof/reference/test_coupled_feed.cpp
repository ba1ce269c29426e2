// The coupled drive's exact answer against the matrix exponential, against an explicit integrator
// where one can be used, and at the stall.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <boost/numeric/odeint.hpp>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <unsupported/Eigen/MatrixFunctions>
#include <vector>

#include "toothprep/proof/reference/closed_forms.h"
#include "toothprep/proof/reference/coupled_feed.h"
#include "toothprep/step/bur/bur_shapes.h"
#include "toothprep/step/core/errors.h"

namespace toothprep::reference {
namespace {

using Vec2 = Eigen::Vector2d;
using Mat2 = Eigen::Matrix2d;

constexpr const char* kCylinder = "cylinder:D1.2xL3.0";
constexpr const char* kBall = "ball:D1.2";

Scene scene_of(const std::string& bur, const Block& block = {{20, 24, 20}, 16}) {
  return make_scene(bur_from_shorthand(bur), block, preset_parameters("paper"));
}
std::vector<double> every(double step, double until) {
  std::vector<double> times;
  for (int i = 0; i * step <= until * (1 + 1e-12); ++i) times.push_back(i * step);
  return times;
}
// The drag across the axis, bur wholly in enamel.
Mat2 plane_drag(const Scene& scene) {
  return engagement(scene, {Vec3(0, -3, 0), Quat::Identity()}, {0, -1, 0})
      .drag.topLeftCorner<2, 2>();
}

TEST(CoupledFeed, EngagedFromTheStartIsTheMatrixExponential) {
  for (const char* bur : {kCylinder, kBall}) {
    const Scene scene = scene_of(bur);
    const Mat2 drag = plane_drag(scene);
    CoupledFeed feed;
    feed.handle = steady_handle({0, -2, 0}, {0.1, -0.5, 0});
    const CoupledResult result = coupled_feed(scene, feed, every(0.05, 10));
    EXPECT_EQ(result.contact, 0.0);
    for (const CoupledRow& row : result.rows) {
      const Eigen::VectorXd f = -constant_drag_force(drag, 1.0, Vec2(0.1, -0.5), row.time);
      EXPECT_NEAR(row.force.x(), f[0], 1e-7);
      EXPECT_NEAR(row.force.y(), f[1], 1e-7);
      EXPECT_NEAR(row.force.z(), 0, 1e-9);
      // The bur's velocity follows from the drag, its torque from the velocity.
      const Vec2 v = drag.lu().solve(Vec2(f[0], f[1]));
      EXPECT_NEAR(row.velocity.x(), v.x(), 1e-7);
      EXPECT_NEAR(row.velocity.y(), v.y(), 1e-7);
    }
    EXPECT_LT(result.largest_residual, 1e-8);
  }
}

TEST(CoupledFeed, MatrixExponentialRisesToTheSteadyForceWithTheKnownTimeConstant) {
  // At alpha = 0.25 the feed component reaches 1 - 1/e after 0.971 B_n / k, B_n = u L / (4 alpha
  // N).
  const Mat2 drag = plane_drag(scene_of(kCylinder));
  const double bn = 9.0, steady = 0.5 * bn;
  EXPECT_NEAR(drag(1, 1), -bn, 1e-9);
  const auto force = [&](double t) { return -constant_drag_force(drag, 1, Vec2(0, -0.5), t)[1]; };
  EXPECT_NEAR(force(0), 0, 1e-15);
  EXPECT_NEAR(force(200), steady, 1e-8);
  EXPECT_NEAR(force(0.971 * bn) / steady, 1 - std::exp(-1.0), 3e-4);  // three digits are stated
}

TEST(CoupledFeed, DampingInTheCouplingHasAClosedFormToo) {
  // k e + b e' + B (v - e') = 0: e = (I - exp(k (B - b)^-1 t)) (-B v / k), force k e + b e'.
  const Scene scene = scene_of(kCylinder);
  const Mat2 drag = plane_drag(scene), slope = (drag - 2.0 * Mat2::Identity()).inverse();
  const Vec2 v(0, -0.5);
  CoupledFeed feed;
  feed.damping = 2;
  feed.handle = steady_handle({0, -2, 0}, {0, -0.5, 0});
  // At t = 0 the damper already pushes; the start P' = 0 -> finite is smooth after it.
  const CoupledResult result = coupled_feed(scene, feed, every(0.1, 5));
  for (const CoupledRow& row : result.rows) {
    if (row.time == 0) continue;
    const Mat2 decay = Mat2(slope * row.time).exp();
    const Vec2 end = -drag * v, e = end - decay * end, rate = -slope * decay * end;
    const Vec2 f = -(e + 2.0 * rate);
    EXPECT_NEAR(row.force.x(), f.x(), 2e-7) << row.time;
    EXPECT_NEAR(row.force.y(), f.y(), 2e-7) << row.time;
  }
}

TEST(CoupledFeed, AgreesWithAnExplicitIntegratorAcrossTheTissueBorder) {
  // Well engaged, P' can be solved for: F(P, P') = -k (P_H - P) by Newton, then Dormand-Prince.
  const Scene scene = scene_of(kCylinder, {{20, 8, 20}, 3});
  CoupledFeed feed;
  feed.stiffness = 3;
  feed.handle = steady_handle({0, -2, 0}, {0, -0.5, 0});
  const std::vector<double> times = every(0.25, 10);
  const CoupledResult result = coupled_feed(scene, feed, times);

  using State = std::vector<double>;
  Vec2 guess(0, -0.1);
  const auto rhs = [&](const State& p, State& rate, double t) {
    const Vec3 handle = feed.handle(t).position;
    const Vec2 e(handle.x() - p[0], handle.y() - p[1]);
    if (e.norm() < 1e-14) {
      rate = {0, 0};
      return;
    }
    for (int pass = 0; pass < 30; ++pass) {
      const Mat2 drag =
          engagement(scene, {Vec3(p[0], p[1], 0), Quat::Identity()}, Vec3(guess.x(), guess.y(), 0))
              .drag.topLeftCorner<2, 2>();
      const Vec2 next = drag.lu().solve(-feed.stiffness * e);
      const double moved = (next - guess).norm();
      guess = next;
      if (moved < 1e-12) break;
    }
    rate = {guess.x(), guess.y()};
  };
  State p = {0, -2};
  std::size_t row = 0;
  bool dentin = false;
  namespace odeint = boost::numeric::odeint;
  odeint::integrate_times(
      odeint::make_controlled(1e-10, 1e-10, odeint::runge_kutta_dopri5<State>()), rhs, p,
      times.begin(), times.end(), 1e-3, [&](const State& at, double) {
        EXPECT_NEAR(result.rows[row].position.x(), at[0], 1e-7);
        EXPECT_NEAR(result.rows[row].position.y(), at[1], 1e-7);
        dentin = dentin || result.rows[row].area[tissue_index(Tissue::kDentin)] > 0.1;
        ++row;
      });
  EXPECT_EQ(row, times.size());
  EXPECT_TRUE(dentin);  // the border was passed
}

TEST(CoupledFeed, EntersABlockFromOutsideAndSettlesAtThePlateau) {
  for (const char* bur : {kCylinder, kBall}) {
    const Scene scene = scene_of(bur, {{8, 40, 8}, 40});
    CoupledFeed feed;
    feed.handle = steady_handle({0, 0.7, 0}, {0, -0.5, 0});
    feed.largest_step = 0.1;
    const CoupledResult result = coupled_feed(scene, feed, every(0.02, 80));
    ASSERT_TRUE(result.contact);
    EXPECT_NEAR(*result.contact, 0.2, 1e-7);  // 0.1 mm at 0.5 mm/s; contact shows from rounding on
    for (const CoupledRow& row : result.rows) {
      if (row.time < 0.2 - 1e-6) {
        EXPECT_EQ(row.position, feed.handle(row.time).position);
        EXPECT_EQ(row.force, Vec3::Zero());
      }
    }
    const Grinding law{300, 0.25, 100};
    const SteadyLoad steady =
        bur == kBall ? ball_side_feed(law, 0.6, 0.5) : cylinder_side_feed(law, 0.6, 3, 0.5);
    const CoupledRow& last = result.rows.back();
    const double rest = steady.against * std::exp(-80.0 / 10);  // the slowest mode, about 9 s
    EXPECT_NEAR(last.force.y(), steady.against, rest);
    EXPECT_NEAR(last.force.x(), steady.across, rest);
    EXPECT_NEAR(last.torque, steady.torque, rest);
    EXPECT_LT(result.largest_residual, 1e-6);
  }
}

TEST(CoupledFeed, TighterToleranceChangesNothingThatCounts) {
  // Entry, and on into dentin. The last case passes the border at 2 to 4 mm/s under a stiff spring,
  // where a step across the kink once was off by 1e-6 mm without knowing it.
  struct Case {
    const char* bur;
    double stiffness, enamel;
    Handle handle;
    double until;
  };
  for (const Case& c : {Case{kCylinder, 1, 0.2, steady_handle({0, 0.7, 0}, {0, -0.5, 0.05}), 4},
                        Case{kBall, 1, 0.4, steady_handle({0, 0.7, 0}, {0, -0.5, 0.05}), 4},
                        Case{kBall, 3, 16, ramped_handle({0, 0.7, 0}, {0, -0.1, 0}), 20}}) {
    const Scene scene = scene_of(c.bur, {{8, 24, 8}, c.enamel});
    CoupledFeed feed;
    feed.stiffness = c.stiffness;
    feed.handle = c.handle;
    std::vector<double> times;
    for (double t = 0; t < c.until; t += 0.037) times.push_back(t);
    const CoupledResult usual = coupled_feed(scene, feed, times);
    feed.tolerance = 1e-12;
    const CoupledResult tight = coupled_feed(scene, feed, times);
    EXPECT_GT(tight.steps, usual.steps);
    EXPECT_GT(tight.rows.back().area[tissue_index(Tissue::kDentin)], 0.5);
    for (std::size_t i = 0; i < times.size(); ++i) {
      EXPECT_LT((usual.rows[i].force - tight.rows[i].force).norm(), 1e-8) << c.bur << times[i];
      EXPECT_NEAR(usual.rows[i].torque, tight.rows[i].torque, 1e-8) << c.bur << times[i];
    }
  }
}

TEST(CoupledFeed, WithoutResistanceAlongTheAxisTheBurFollowsTheHandleThere) {
  // A cylinder pulled up along its axis while it is fed: its side doesn't advance along z, so that
  // nothing holds it back. Explicit integration can't do this: the drag is singular.
  const Scene scene = scene_of(kCylinder);
  CoupledFeed feed;
  feed.handle = steady_handle({0, 0.7, 0}, {0, -0.5, 0.2});
  const CoupledResult result = coupled_feed(scene, feed, every(0.05, 5));
  for (const CoupledRow& row : result.rows) {
    EXPECT_NEAR(row.force.z(), 0, 1e-9);
    EXPECT_NEAR(row.position.z(), 0.2 * row.time, 1e-9);
  }
}

TEST(CoupledFeed, CreepsOnWhenTheHandleStops) {
  // After the handle stops the spring relaxes: e(t) = exp(k B^-1 t) e(0).
  const Scene scene = scene_of(kCylinder);
  const Mat2 drag = plane_drag(scene);
  CoupledFeed feed;
  feed.handle = [](double t) {
    return HandleMotion{Vec3(0, -2 - 0.5 * std::min(t, 3.0), 0), Vec3(0, t < 3 ? -0.5 : 0, 0)};
  };
  feed.handle_breaks = {3.0};
  const CoupledResult result = coupled_feed(scene, feed, every(0.1, 8));
  const Vec2 start = -constant_drag_force(drag, 1, Vec2(0, -0.5), 3);
  for (const CoupledRow& row : result.rows) {
    if (row.time < 3) continue;
    const Vec2 f = Mat2(drag.inverse() * (row.time - 3)).exp() * start;
    EXPECT_NEAR(row.force.x(), f.x(), 2e-7);
    EXPECT_NEAR(row.force.y(), f.y(), 2e-7);
  }
}

TEST(CoupledFeed, BreaksThroughAThinBlockAndIsFreeAgain) {
  const Scene scene = scene_of(kBall, {{8, 0.5, 8}, 0.5});
  CoupledFeed feed;
  feed.handle = steady_handle({0, 0.7, 0}, {0, -0.5, 0});
  const CoupledResult result = coupled_feed(scene, feed, every(0.02, 6));
  ASSERT_TRUE(result.break_through);
  double lowest = 0;
  for (const CoupledRow& row : result.rows) {
    if (row.time < *result.break_through) {
      lowest = std::min(lowest, row.position.y());
    } else {
      EXPECT_EQ(row.position, feed.handle(row.time).position);
      EXPECT_EQ(row.force, Vec3::Zero());
    }
  }
  // The front half has left the block when the axis is at its lower face; it was not past it.
  EXPECT_GT(lowest, -0.5);
  EXPECT_GT(result.rows[130].force.y(), 0.5);
}

TEST(CoupledFeed, StallsAtTheSpeedAndForceOfTheClosedForms) {
  // The handle accelerates; the bur, wholly engaged, stands still when its speed reaches
  // tau_s pi N / (u R L).
  const Scene scene = scene_of(kCylinder);
  CoupledFeed feed;
  feed.handle = ramped_handle({0, 0.7, 0}, {0, -0.1, 0});
  feed.stall_torque = 1.2;
  const CoupledResult result = coupled_feed(scene, feed, every(0.05, 18));
  ASSERT_TRUE(result.stall);
  const Grinding law{300, 0.25, 100};
  const SteadyLoad at_stall = cylinder_at_stall(0.25, 0.6, 1.2);
  EXPECT_NEAR(result.stall->velocity.norm(), cylinder_stall_speed(law, 0.6, 3, 1.2), 1e-8);
  EXPECT_NEAR(result.stall->force.norm(), std::hypot(at_stall.against, at_stall.across), 1e-7);
  EXPECT_GT(0.1 * result.stall->time, 1.1);  // the handle is by then faster than the bur
  for (const CoupledRow& row : result.rows) {
    EXPECT_EQ(row.stalled, row.time >= result.stall->time);
    EXPECT_LE(row.torque, 1.2);
    if (!row.stalled) continue;
    EXPECT_EQ(row.velocity, Vec3::Zero());
    EXPECT_EQ(row.position, result.stall->position);
    EXPECT_EQ(row.torque, 1.2);
    // Only the spring is left: its force grows with the handle's way.
    const Vec3 way = feed.handle(row.time).position - feed.handle(result.stall->time).position;
    EXPECT_LT((row.force - result.stall->force + way).norm(), 1e-12);
    EXPECT_LT((row.force + stalled_force(feed, row.position, row.time)).norm(), 1e-12);
  }
}

TEST(CoupledFeed, StallTimeOfARampIsThatOfTheExponential) {
  // e' = a t - K e, K = k (-B)^-1: e = K^-1 a t - K^-2 (I - exp(-K t)) a, bur velocity K e; engaged
  // from the start. The time at which |K e| is the stall speed, by bisection.
  const Scene scene = scene_of(kCylinder, {{20, 40, 20}, 40});
  const Mat2 inverse = -plane_drag(scene), rate = inverse.inverse();
  const Vec2 a(0, -0.1);
  const double stall_speed = cylinder_stall_speed({300, 0.25, 100}, 0.6, 3, 1.2);
  const auto speed = [&](double t) {
    return Vec2(a * t - inverse * (a - Mat2(-rate * t).exp() * a)).norm();
  };
  double low = 0, high = 30;
  while (high - low > 1e-12)
    (speed((low + high) / 2) < stall_speed ? low : high) = (low + high) / 2;
  CoupledFeed feed;
  feed.handle = ramped_handle({0, -2, 0}, {0, -0.1, 0});
  feed.stall_torque = 1.2;
  const CoupledResult result = coupled_feed(scene, feed, {0, 30});
  ASSERT_TRUE(result.stall);
  EXPECT_NEAR(result.stall->time, low, 1e-6);
}

TEST(CoupledFeed, AdvancingSurfaceMeetsFreshTissueOnThePapersPaths) {
  // The bur yields sideways at the entry; the solution is exact if it never grinds where it has
  // been.
  for (const char* name : {kCylinder, kBall}) {
    const Bur bur = bur_from_shorthand(name);
    const Scene scene = scene_of(name);
    CoupledFeed feed;
    feed.handle = steady_handle({0, 0.7, 0}, {0, -0.5, 0});
    const CoupledResult result = coupled_feed(scene, feed, every(0.02, 8));
    EXPECT_LT(stale_depth(scene, bur, feed, result.rows, 1), 1e-6);
  }
}

TEST(CoupledFeed, StaleDepthSeesAPathThatTurnsBack) {
  // Back and forth through the same tissue: on the way back the foremost points lie in the slot, by
  // about the radius.
  const Bur bur = bur_from_shorthand(kBall);
  std::vector<CoupledRow> rows;
  for (int i = 0; i < 200; ++i) {
    CoupledRow row;
    row.time = i * 0.02;
    row.position = Vec3(i < 100 ? 0.02 * i : 2 - 0.02 * (i - 100), -1, 0);
    row.velocity = Vec3(i < 100 ? 1 : -1, 0, 0);
    rows.push_back(row);
  }
  EXPECT_NEAR(stale_depth(scene_of(kBall), bur, {}, rows, 1), 0.6, 0.1);
}

TEST(CoupledFeed, MissesTheBlockWithoutAForce) {
  CoupledFeed feed;
  feed.handle = steady_handle({0, 5, 0}, {0.5, 0, 0});
  const CoupledResult result = coupled_feed(scene_of(kBall), feed, every(0.5, 3));
  EXPECT_FALSE(result.contact);
  EXPECT_EQ(result.rows.back().position, Vec3(1.5, 5, 0));
  EXPECT_EQ(result.rows.back().velocity, Vec3(0.5, 0, 0));
  EXPECT_TRUE(coupled_feed(scene_of(kBall), feed, {}).rows.empty());
}

TEST(CoupledFeed, RefusesWhatIsOutOfRange) {
  const Scene scene = scene_of(kBall);
  CoupledFeed good;
  good.handle = steady_handle({0, 5, 0}, {0, -0.5, 0});
  CoupledFeed bad = good;
  bad.stiffness = 0;
  EXPECT_THROW(coupled_feed(scene, bad, {0, 1}), Error);
  bad = good;
  bad.damping = -1;
  EXPECT_THROW(coupled_feed(scene, bad, {0, 1}), Error);
  bad = good;
  bad.stall_torque = std::nan("");
  EXPECT_THROW(coupled_feed(scene, bad, {0, 1}), Error);
  bad = good;
  bad.handle = nullptr;
  EXPECT_THROW(coupled_feed(scene, bad, {0, 1}), Error);
  EXPECT_THROW(coupled_feed(scene, good, {0, 1, 1}), Error);
  EXPECT_THROW(constant_drag_force(Eigen::MatrixXd::Zero(2, 2), 1, Vec2(0, 1), 1), Error);
  EXPECT_THROW(constant_drag_force(Eigen::MatrixXd::Identity(3, 3), 1, Vec2(0, 1), 1), Error);
}

}  // namespace
}  // namespace toothprep::reference
