#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <random>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/device/closed_loop.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;

constexpr HandModel kNoHand{0, 0, 0};

PhantomModel without_friction() {
  PhantomModel m;
  m.friction = 0;
  m.damping = 0;
  return m;
}

void ticks(SimulatedPhantom& phantom, int count, const Vec3& force, const Vec3& intended) {
  for (int n = 0; n < count; ++n) phantom.tick(force, intended);
}

// (M/2) v² + (k_h/2) |p - x|², N·mm.
double energy(const SimulatedPhantom& d) {
  const double mass = d.model().apparent_mass + d.hand().mass;
  return 0.5 * mass * d.true_velocity().squaredNorm() +
         0.5 * d.hand().stiffness * (d.intended_position() - d.true_position()).squaredNorm();
}

// A step of force on the damped oscillator of device and hand, from rest:
//   x = F/k (1 - e^(-a t) (cos w t + (a/w) sin w t)),  a = c/(2M),  w² = k/M - a²
double step_of_force(const PhantomModel& m, const HandModel& h, double force, double t) {
  const double mass = m.apparent_mass + h.mass, a = (m.damping + h.damping) / (2 * mass);
  const double w = std::sqrt(h.stiffness / mass - a * a);
  return force / h.stiffness * (1 - std::exp(-a * t) * (std::cos(w * t) + a / w * std::sin(w * t)));
}

TEST(SimulatedPhantom, WithoutFrictionItAnswersAStepOfForceAsADampedOscillator) {
  PhantomModel model;
  model.friction = 0;
  const HandModel hand;
  SimulatedPhantom phantom(model, hand, Vec3(1, 2, 3));
  double largest = 0;
  for (int n = 1; n <= 300; ++n) {
    phantom.tick(Vec3(0.5, 0, -1), Vec3(1, 2, 3));
    const Vec3 moved = phantom.true_position() - Vec3(1, 2, 3);
    const double t = n * model.time_step();
    largest = std::max({largest, std::abs(moved.x() - step_of_force(model, hand, 0.5, t)) / 0.5,
                        std::abs(moved.z() - step_of_force(model, hand, -1, t)) / 1.0,
                        std::abs(moved.y())});
  }
  // The phase of the midpoint rule errs by (w h)²/12 of w t: w = 68 rad/s, h = 20 us, and motion
  // has died away after w t = 10: 1.5e-6 of F/k = 3.3 mm per N.
  EXPECT_LT(largest, 5e-6);
}

TEST(SimulatedPhantom, ItConvergesWithTheSquareOfTheSubStep) {
  PhantomModel model;
  model.friction = 0;
  const HandModel hand;
  const auto error = [&](int sub_steps) {
    model.sub_steps = sub_steps;
    SimulatedPhantom phantom(model, hand, Vec3::Zero());
    ticks(phantom, 30, Vec3(1, 0, 0), Vec3::Zero());
    return std::abs(phantom.true_position().x() - step_of_force(model, hand, 1, 0.03));
  };
  EXPECT_NEAR(error(1) / error(2), 4, 0.1);
  EXPECT_NEAR(error(4) / error(8), 4, 0.1);
}

TEST(SimulatedPhantom, WithStickAndSlipItConvergesToo) {
  // The hand pulls and swings, the handle sticks and slips; 4000 sub-steps are the reference. The
  // start of a slip is found to one sub-step: at least first order.
  PhantomModel model;
  const auto path = [&](int sub_steps) {
    model.sub_steps = sub_steps;
    SimulatedPhantom phantom(model, HandModel{}, Vec3::Zero());
    std::vector<double> x;
    for (int n = 1; n <= 400; ++n) {
      phantom.tick(Vec3::Zero(), Vec3(0.5 * std::sin(0.03 * n), 0, 0));
      x.push_back(phantom.true_position().x());
    }
    return x;
  };
  const auto distance = [](const std::vector<double>& a, const std::vector<double>& b) {
    double largest = 0;
    for (std::size_t i = 0; i < a.size(); ++i) largest = std::max(largest, std::abs(a[i] - b[i]));
    return largest;
  };
  const std::vector<double> reference = path(4000);
  const double coarse = distance(path(5), reference), fine = distance(path(50), reference);
  EXPECT_LT(fine, coarse / 10);
  EXPECT_LT(fine, 0.023 / 1000);  // far below a count at the default
}

TEST(SimulatedPhantom, WithoutLossesItKeepsItsEnergy) {
  for (const int sub_steps : {1, 50}) {
    PhantomModel model = without_friction();
    model.sub_steps = sub_steps;
    SimulatedPhantom phantom(model, HandModel{0, 0.3, 0}, Vec3::Zero());
    ticks(phantom, 20, Vec3(1, -0.5, 0.2), Vec3::Zero());
    const double released = energy(phantom);
    ticks(phantom, 5000, Vec3::Zero(), Vec3::Zero());
    EXPECT_NEAR(energy(phantom), released, 1e-9 * released);  // 250 000 roundings
  }
}

TEST(SimulatedPhantom, LeftAloneItNeverGainsEnergy) {
  for (const int sub_steps : {1, 3, 50})
    for (const double friction : {0.0, 0.06, 0.5})
      for (const double damping : {0.0, 2e-3}) {
        PhantomModel model;
        model.sub_steps = sub_steps;
        model.friction = friction;
        SimulatedPhantom phantom(model, HandModel{0, 0.3, damping}, Vec3::Zero());
        ticks(phantom, 20, Vec3(3, -2, 1), Vec3::Zero());
        for (int n = 0; n < 2000; ++n) {
          const double before = energy(phantom);
          phantom.tick(Vec3::Zero(), Vec3::Zero());
          ASSERT_LE(energy(phantom), before * (1 + 1e-12)) << "tick " << n;
        }
        const bool rests = phantom.true_velocity() == Vec3::Zero();
        EXPECT_TRUE(friction == 0 || rests);
      }
}

TEST(SimulatedPhantom, ItGainsNoMoreEnergyThanTheMotorsPutIn) {
  std::mt19937_64 random(7);  // a seeded generator; its integers are the same everywhere
  const auto uniform = [&] { return 2.0 * static_cast<double>(random() >> 11) * 0x1p-53 - 1; };
  for (const int sub_steps : {1, 50}) {
    PhantomModel model;
    model.sub_steps = sub_steps;
    SimulatedPhantom phantom(model, HandModel{}, Vec3::Zero());
    for (int n = 0; n < 3000; ++n) {
      const double before = energy(phantom);
      const Vec3 from = phantom.true_position();
      phantom.tick(Vec3(uniform(), uniform(), uniform()), Vec3::Zero());
      const double work = phantom.motor_force().dot(phantom.true_position() - from);
      ASSERT_LE(energy(phantom) - before, work + 1e-12) << "tick " << n;
    }
  }
}

TEST(SimulatedPhantom, FrictionHoldsItUpToItsLimit) {
  for (const double sign : {1.0, -1.0}) {
    SimulatedPhantom held(PhantomModel{}, kNoHand, Vec3::Zero());
    ticks(held, 1000, Vec3(0.0599 * sign, 0.06 * sign, 0), Vec3::Zero());
    EXPECT_EQ(held.true_position(), Vec3::Zero());
    EXPECT_EQ(held.true_velocity(), Vec3::Zero());
    SimulatedPhantom moved(PhantomModel{}, kNoHand, Vec3::Zero());
    ticks(moved, 10, Vec3(0.0601 * sign, 0, 0), Vec3::Zero());
    EXPECT_GT(moved.true_position().x() * sign, 0);
  }
}

TEST(SimulatedPhantom, ItSlidesToRestOverTheDistanceThatFrictionAllows) {
  // 1 N for 10 ms: v = (1 - f) t/m after x = v t/2; then friction alone: x += m v²/(2 f), and rest.
  PhantomModel model = without_friction();
  model.friction = 0.06;
  SimulatedPhantom phantom(model, kNoHand, Vec3::Zero());
  ticks(phantom, 10, Vec3(0, 1, 0), Vec3::Zero());
  const double v = (1 - 0.06) * 0.01 / model.apparent_mass;
  EXPECT_NEAR(phantom.true_velocity().y(), v, 1e-9 * v);
  ticks(phantom, 300, Vec3::Zero(), Vec3::Zero());
  const double slid = v * 0.01 / 2 + model.apparent_mass * v * v / (2 * 0.06);
  EXPECT_NEAR(phantom.true_position().y(), slid, 1e-9 * slid);  // the midpoint rule is exact here
  EXPECT_EQ(phantom.true_velocity().y(), 0);
}

TEST(SimulatedPhantom, APulledHandleBreaksAwayWhenTheHandExceedsFriction) {
  // k_h v t + b_h v = f_c, with v = 0.5 mm/s: t = (0.06 - 0.001)/0.15 = 0.3933 s.
  const HandModel hand;
  SimulatedPhantom phantom(PhantomModel{}, hand, Vec3::Zero());
  int breakaway = 0;
  for (int n = 1; n <= 1000 && breakaway == 0; ++n) {
    phantom.tick(Vec3::Zero(), Vec3(0.5e-3 * n, 0, 0));
    if (phantom.true_velocity().x() != 0) breakaway = n;
  }
  EXPECT_EQ(breakaway, 394);  // within tick 394, from 0.393 to 0.394 s
}

TEST(SimulatedPhantom, TheEncoderIsOffByHalfACountAtMost) {
  const PhantomModel model;
  SimulatedPhantom phantom(model, HandModel{}, Vec3(0.1, -7.3, 2));
  double largest = 0;
  for (int n = 1; n <= 2000; ++n) {
    phantom.tick(Vec3::Zero(), Vec3(0.1, -7.3, 2) + Vec3(5e-4, -3e-3, 0.02) * n);
    const Vec3 reading = phantom.encoder_position();
    largest = std::max(largest, (reading - phantom.true_position()).cwiseAbs().maxCoeff());
    for (int axis = 0; axis < 3; ++axis) {  // whole counts
      const double counts = reading[axis] / model.encoder_count;
      ASSERT_NEAR(counts, std::round(counts), 1e-9);
    }
  }
  EXPECT_LE(largest, model.encoder_count / 2 * (1 + 1e-9));
  EXPECT_GT(largest, model.encoder_count * 0.49);  // and it does use the half count
}

TEST(SimulatedPhantom, AnEncoderWithoutCountsReadsTheTruePosition) {
  PhantomModel model;
  model.encoder_count = 0;
  SimulatedPhantom phantom(model, HandModel{}, Vec3::Zero());
  ticks(phantom, 50, Vec3(0.3, 0.4, 0.5), Vec3::Zero());
  EXPECT_EQ(phantom.encoder_position(), phantom.true_position());
}

TEST(SimulatedPhantom, AForceAboveTheLimitKeepsItsDirection) {
  SimulatedPhantom phantom(PhantomModel{}, HandModel{}, Vec3::Zero());
  phantom.tick(Vec3(6, 0, -8), Vec3::Zero());
  EXPECT_LT((phantom.motor_force() - 0.79 * Vec3(6, 0, -8)).norm(), 1e-12);
  EXPECT_EQ(phantom.clamped_ticks(), 1);
  phantom.tick(Vec3(4, 4, 4), Vec3::Zero());  // norm 6.93
  EXPECT_EQ(phantom.motor_force(), Vec3(4, 4, 4));
  EXPECT_EQ(phantom.clamped_ticks(), 1);
  phantom.tick(Vec3::Constant(1e300), Vec3::Zero());  // whose square would overflow
  EXPECT_NEAR(phantom.motor_force().norm(), 7.9, 1e-12);
}

TEST(SimulatedPhantom, ADelayedForceComesWholeTicksLater) {
  for (const int delay : {0, 1, 2, kLargestDelayTicks}) {
    PhantomModel model;
    model.delay_ticks = delay;
    SimulatedPhantom phantom(model, HandModel{}, Vec3::Zero());
    for (int n = 0; n < 50; ++n) {
      phantom.tick(Vec3(0.1 * (n + 1), 0, 0), Vec3::Zero());
      EXPECT_EQ(phantom.motor_force().x(), n < delay ? 0 : 0.1 * (n - delay + 1));
    }
  }
}

TEST(SimulatedPhantom, WhatIsNotFiniteIsNotObeyed) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinite = std::numeric_limits<double>::infinity();
  SimulatedPhantom phantom(PhantomModel{}, HandModel{}, Vec3::Zero());
  phantom.tick(Vec3(1, 0, 0), Vec3(0.1, 0, 0));
  phantom.tick(Vec3(nan, 1, 0), Vec3(0.2, 0, 0));
  EXPECT_EQ(phantom.motor_force(), Vec3::Zero());
  phantom.tick(Vec3(1, 0, 0), Vec3(0, infinite, 0));
  EXPECT_EQ(phantom.intended_position(), Vec3(0.2, 0, 0));
  EXPECT_EQ(phantom.rejected_inputs(), 2);
  EXPECT_TRUE(phantom.true_position().allFinite());
}

TEST(SimulatedPhantom, ACopyContinuesWithTheSameBits) {
  PhantomModel model;
  model.delay_ticks = 3;
  SimulatedPhantom first(model, HandModel{}, Vec3::Zero());
  const auto advance = [](SimulatedPhantom& d, int from, int to) {
    for (int n = from; n < to; ++n)
      d.tick(Vec3(0.3 * std::sin(0.1 * n), 0.2, -0.1), Vec3(0.002, -0.001, 0.0005) * n);
  };
  advance(first, 0, 500);
  SimulatedPhantom second = first;
  advance(first, 500, 1500);
  advance(second, 500, 1500);
  SimulatedPhantom again(model, HandModel{}, Vec3::Zero());
  advance(again, 0, 1500);
  for (const SimulatedPhantom* other : {&second, &again}) {
    EXPECT_EQ(std::memcmp(first.true_position().data(), other->true_position().data(), 24), 0);
    EXPECT_EQ(std::memcmp(first.true_velocity().data(), other->true_velocity().data(), 24), 0);
  }
}

TEST(SimulatedPhantom, ParametersThatMakeNoSenseAreNamed) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [](const std::string& name,
                          const std::function<void(PhantomModel&)>& spoil) {
    PhantomModel model;
    spoil(model);
    try {
      SimulatedPhantom phantom(model, HandModel{}, Vec3::Zero());
      ADD_FAILURE() << name << " was accepted";
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr(name));
    }
  };
  refused("apparent_mass", [](PhantomModel& m) { m.apparent_mass = 0; });
  refused("phantom.damping", [](PhantomModel& m) { m.damping = -1; });
  refused("friction", [&](PhantomModel& m) { m.friction = nan; });
  refused("encoder_count", [](PhantomModel& m) { m.encoder_count = -0.023; });
  refused("force_limit", [](PhantomModel& m) { m.force_limit = 0; });
  refused("rate", [](PhantomModel& m) { m.rate = -1000; });
  refused("delay_ticks", [](PhantomModel& m) { m.delay_ticks = kLargestDelayTicks + 1; });
  refused("sub_steps", [](PhantomModel& m) { m.sub_steps = 0; });
  EXPECT_THROW(validate(HandModel{-1e-6, 0.3, 2e-3}), Error);
  EXPECT_THROW(validate(HandModel{0, nan, 2e-3}), Error);
  EXPECT_THROW(validate(HandModel{0, 0.3, -1}), Error);
  EXPECT_THROW(SimulatedPhantom(PhantomModel{}, HandModel{}, Vec3(0, nan, 0)), Error);
}

TEST(ClosedLoop, RowsHoldTheReadingAndTheForceComputedFromIt) {
  PhantomModel model;
  model.force_limit = 1;
  SimulatedPhantom phantom(model, HandModel{}, Vec3::Zero());
  std::vector<Vec3> path;
  for (int n = 0; n < 200; ++n) path.push_back(Vec3(0.05 * n, 0, 0));
  std::vector<std::size_t> asked;
  const ClosedLoopSeries s = run_closed_loop(phantom, path, [&](std::size_t tick, const Vec3& e) {
    asked.push_back(tick);
    return Vec3(-0.5 * e);
  });
  ASSERT_EQ(s.time.size(), path.size());
  EXPECT_EQ(asked.front(), 1u);
  EXPECT_EQ(asked.back(), path.size() - 1);
  EXPECT_EQ(s.force[0], Vec3::Zero());
  for (std::size_t n = 1; n < path.size(); ++n) {
    EXPECT_EQ(s.command[n], -0.5 * s.encoder[n]);
    EXPECT_LE(s.force[n].norm(), 1 + 1e-12);
    EXPECT_EQ(s.intended[n], path[n]);
    EXPECT_DOUBLE_EQ(s.time[n], 1e-3 * static_cast<double>(n));
  }
  EXPECT_GT(s.command.back().norm(), 1);  // the limit did act
  EXPECT_EQ(phantom.clamped_ticks(), std::count_if(s.command.begin(), s.command.end(),
                                                   [](const Vec3& f) { return f.norm() > 1; }));
  EXPECT_THROW(run_closed_loop(phantom, {}, [](std::size_t, const Vec3& e) { return e; }), Error);
}

TEST(ClosedLoop, FiguresCountBackwardAndSaturatedRows) {
  // Backward in a tenth of the rows, at the limit in a twentieth, force 2 N up and down in x.
  const PhantomModel model;
  ClosedLoopSeries s;
  for (int n = 0; n < 1000; ++n) {
    s.time.push_back(1e-3 * n);
    s.velocity.push_back(Vec3(n % 10 == 0 ? -1 : 1, 0, 0));
    s.force.push_back(n % 20 == 0 ? Vec3(0, 7.9, 0) : Vec3(n % 2 == 0 ? 1 : -1, 0, 0));
  }
  const ClosedLoopFigures f = closed_loop_figures(s, model, Vec3(2, 0, 0));
  EXPECT_DOUBLE_EQ(f.backward_fraction, 0.1);
  EXPECT_DOUBLE_EQ(f.saturated_fraction, 0.05);
  EXPECT_DOUBLE_EQ(f.force_peak_to_peak, 2);
  EXPECT_EQ(f.verdict, LoopVerdict::kUnstable);
  EXPECT_DOUBLE_EQ(closed_loop_figures(s, model, -Vec3::UnitX()).backward_fraction, 0.9);
  EXPECT_THROW(closed_loop_figures(s, model, Vec3::Zero()), Error);
  EXPECT_THROW(closed_loop_figures(s, model, Vec3::UnitX(), 0.95), Error);
}

}  // namespace
}  // namespace toothprep
