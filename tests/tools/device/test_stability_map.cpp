#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <cstring>

#include "toothprep/tools/device/stability_map.h"

namespace toothprep {
namespace {

// Largest |eigenvalue| of a mass M under F = -B (backward difference), d ticks late, held for a
// tick: with the mean speeds w_n of the ticks, v_n+1 = v_n - (BT/M) w_n-d and
// w_n+1 = v_n - (BT/2M) w_n-d, exactly.
double spectral_radius(double bt_over_m, int delay) {
  const int n = delay + 2;  // v, w_n, ..., w_n-d
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n, n);
  a(0, 0) = 1;
  a(0, n - 1) = -bt_over_m;
  a(1, 0) = 1;
  a(1, n - 1) += -bt_over_m / 2;
  for (int i = 2; i < n; ++i) a(i, i - 1) = 1;
  return a.eigenvalues().cwiseAbs().maxCoeff();
}

TEST(Limits, TheLinearDamperLimitIsWhereAnEigenvalueLeavesTheUnitCircle) {
  for (const int delay : {0, 1, 2, 3, 7}) {
    const double limit = linear_damping_limit(1, 1, delay);
    EXPECT_LT(spectral_radius(0.999 * limit, delay), 1 + 1e-12) << delay;
    EXPECT_GT(spectral_radius(1.001 * limit, delay), 1 + 1e-6) << delay;
  }
  EXPECT_NEAR(linear_damping_limit(1, 1, 0), 2, 1e-12);
  EXPECT_NEAR(linear_damping_limit(1, 1, 1), 2 * (std::sqrt(2.0) - 1), 1e-12);  // 0.828
  EXPECT_NEAR(linear_damping_limit(1, 1, 2), 2 * (2 - std::sqrt(3.0)), 1e-12);  // 0.536
  EXPECT_NEAR(linear_damping_limit(units::from_gram(45), 1e-3, 0), 0.090, 1e-12);
}

// A device without friction, counts, or hand but for what `hand` says.
PhantomModel linear_device(double mass, int delay) {
  PhantomModel m;
  m.apparent_mass = mass;
  m.damping = m.friction = m.encoder_count = 0;
  m.delay_ticks = delay;
  m.force_limit = 1e9;
  m.sub_steps = 5;  // the midpoint rule is exact for a constant force
  return m;
}

// Largest speed in the first and in the last tenth of a run without a hand's motion, whose force is
// a small kick and then `render`.
template <class Render>
double growth(const PhantomModel& model, const HandModel& hand, std::size_t rows, Render render) {
  SimulatedPhantom phantom(model, hand, Vec3::Zero());
  const std::vector<Vec3> path(rows, Vec3::Zero());
  const auto s = run_closed_loop(phantom, path, [&](std::size_t tick, const Vec3& e) {
    return Vec3(render(tick, e) + (tick == 1 ? Vec3(0.1, 0, 0) : Vec3(Vec3::Zero())));
  });
  double first = 0, last = 0;
  for (std::size_t n = 0; n < rows / 10; ++n) {
    first = std::max(first, s.velocity[n].norm());
    last = std::max(last, s.velocity[rows - 1 - n].norm());
  }
  return last / first;
}

TEST(Limits, TheSimulatedDeviceLeavesStabilityAtTheLinearDamperLimit) {
  for (const int delay : {0, 1, 2}) {
    const PhantomModel model = linear_device(units::from_gram(45), delay);
    const double limit = linear_damping_limit(model.apparent_mass, model.time_step(), delay);
    const auto run = [&](double damping) {
      return growth(model, HandModel{0, 0, 0}, 2000,
                    LinearDamper(Rendering::kDirect, damping, model.time_step(), {}, Vec3::Zero()));
    };
    EXPECT_LT(run(0.98 * limit), 0.01) << delay;
    EXPECT_GT(run(1.02 * limit), 100) << delay;
  }
}

TEST(Limits, TheSimulatedDeviceLeavesStabilityAtTheCouplingLimit) {
  // A sampled spring on 1 kg; arm and hand damp it together, 2 (0.2 + 0.3)/1 N/mm. Over 10 s the
  // amplitude changes by exp(-+0.1 b t/(2 m)) = exp(-+0.25) for 10 % of spring more or less.
  PhantomModel model = linear_device(1e-3, 0);
  model.damping = 0.2e-3;
  const HandModel hand{0, 0, 0.3e-3};
  const double limit = coupling_stiffness_limit(0.5e-3, model.time_step());
  EXPECT_NEAR(limit, 1.0, 1e-12);
  const auto run = [&](double stiffness) {
    return growth(model, hand, 10000,
                  [&](std::size_t, const Vec3& e) { return Vec3(-stiffness * e); });
  };
  EXPECT_LT(run(0.9 * limit), 0.9);
  EXPECT_GT(run(1.1 * limit), 1.1);
}

TEST(Limits, TheOtherRulesAreAsQuoted) {
  EXPECT_NEAR(quantisation_damping_limit(units::from_gram(45), 0.5, 0.023), 0.98e-3, 0.01e-3);
  EXPECT_NEAR(friction_damping_limit(0.06, 1e-3, 0.023), 5.2e-3, 0.05e-3);
  EXPECT_NEAR(friction_stiffness_limit(0.06, 0.023), 5.2, 0.05);
}

LinearDamperExperiment reference(Rendering rendering) {
  LinearDamperExperiment e;
  e.hand.mass = 0;
  e.rendering = rendering;
  return e;
}

TEST(StabilityMap, DirectRenderingLeavesStabilityAtTheLimitsOfFrictionAndOfTheLinearLoop) {
  // Per mass: stable just below 2 f_c T/D, no more just above; bounded just below 2M/T, unstable
  // just above. The first does not depend on the mass, the second is in proportion to it.
  const double friction = friction_damping_limit(0.06, 1e-3, 0.023);
  const std::vector<double> masses = {units::from_gram(30), units::from_gram(45),
                                      units::from_gram(60)};
  const auto low = stability_map(reference(Rendering::kDirect), {0.9 * friction, 1.3 * friction},
                                 MapAxis::kApparentMass, masses);
  for (std::size_t i = 0; i < masses.size(); ++i) {
    EXPECT_EQ(low.at(i, 0).verdict, LoopVerdict::kStable) << i;
    EXPECT_EQ(low.at(i, 1).verdict, LoopVerdict::kVibrates) << i;
    const double linear = linear_damping_limit(masses[i], 1e-3, 0);
    const auto high = stability_map(reference(Rendering::kDirect), {0.85 * linear, 1.15 * linear},
                                    MapAxis::kApparentMass, {masses[i]});
    EXPECT_EQ(high.at(0, 0).verdict, LoopVerdict::kVibrates) << i;
    EXPECT_EQ(high.at(0, 1).verdict, LoopVerdict::kUnstable) << i;
  }
}

TEST(StabilityMap, AtSlowSpeedFrictionSetsTheBoundOfDirectRendering) {
  // The hand must first stretch its spring by f_c/k_h before the handle moves: longer settling.
  for (const double friction : {0.03, 0.06, 0.12})
    for (const double speed : {0.1, 0.5}) {
      auto base = reference(Rendering::kDirect);
      base.phantom.friction = friction;
      base.speed = speed;
      base.settling = friction / base.hand.stiffness / speed + 0.5;
      base.duration = base.settling + 1.5;
      const double limit = friction_damping_limit(friction, 1e-3, 0.023);
      const auto map = stability_map(base, {0.95 * limit, 1.1 * limit}, MapAxis::kApparentMass,
                                     {units::from_gram(45)});
      EXPECT_EQ(map.at(0, 0).verdict, LoopVerdict::kStable) << friction << ", " << speed;
      EXPECT_EQ(map.at(0, 1).verdict, LoopVerdict::kVibrates) << friction << ", " << speed;
    }
}

TEST(StabilityMap, CouplingIsStableForAllDampingBelowItsStiffnessLimits) {
  const std::vector<double> dampings = {0.01, 0.1, 1, 9};
  const double limit = coupling_stiffness_limit(2.05e-3, 1e-3);  // 4.1 N/mm
  const auto map = stability_map(reference(Rendering::kCoupled), dampings,
                                 MapAxis::kCouplingStiffness, {0.2, 1, 0.95 * limit, 32});
  for (std::size_t j = 0; j < dampings.size(); ++j)
    for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(map.at(i, j).verdict, LoopVerdict::kStable);
  // Far above both limits the device shakes against the resting bur, while a bur that hardly
  // resists comes along.
  EXPECT_EQ(map.at(3, 0).verdict, LoopVerdict::kVibrates);
  EXPECT_EQ(map.at(3, 2).verdict, LoopVerdict::kUnstable);
  EXPECT_EQ(map.at(3, 3).verdict, LoopVerdict::kUnstable);
}

TEST(StabilityMap, ThreadsDoNotChangeABit) {
  auto base = reference(Rendering::kDirect);
  base.duration = 0.7;
  const auto map = [&] {
    return stability_map(base, {0.002, 0.02, 0.2}, MapAxis::kApparentMass, {30e-6, 45e-6, 60e-6});
  };
  const auto many = map();
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const auto single = map();
  ASSERT_EQ(many.figures.size(), 9u);
  for (std::size_t i = 0; i < many.figures.size(); ++i) {
    EXPECT_EQ(many.figures[i].force_rms_above_20, single.figures[i].force_rms_above_20);
    EXPECT_EQ(many.figures[i].backward_fraction, single.figures[i].backward_fraction);
    EXPECT_EQ(many.figures[i].verdict, single.figures[i].verdict);
  }
}

TEST(StabilityMap, CellsAreTheSingleExperiments) {
  auto base = reference(Rendering::kCoupled);
  base.duration = 0.7;
  const auto map = stability_map(base, {0.1, 1}, MapAxis::kCouplingStiffness, {0.5, 2});
  base.damping = 1;
  base.coupling.stiffness = 0.5;
  EXPECT_EQ(map.at(0, 1).force_rms_above_20, run_linear_damper(base).figures.force_rms_above_20);
}

TEST(StabilityMap, NonsenseIsRefused) {
  const auto base = reference(Rendering::kDirect);
  EXPECT_THROW(stability_map(base, {}, MapAxis::kApparentMass, {1e-5}), Error);
  EXPECT_THROW(stability_map(base, {0.1}, MapAxis::kApparentMass, {}), Error);
  EXPECT_THROW(stability_map(base, {0.1}, MapAxis::kCouplingStiffness, {1}), Error);
  EXPECT_THROW(stability_map(base, {0.1}, MapAxis::kApparentMass, {-1}), Error);  // out of a thread
}

}  // namespace
}  // namespace toothprep
