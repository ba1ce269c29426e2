// A bur on its coupling: the closed forms against the step that sessions make, and against each
// other where steps become small.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "toothprep/proof/reference/coupling_response.h"
#include "toothprep/step/session/implicit_step.h"

namespace toothprep::reference {
namespace {

constexpr double kMass = 8e-6;  // 8 g

// Positions after 0, 1, ... steps of a release from rest at 1 mm.
std::vector<double> stepped(const BurOnCoupling& c, int steps) {
  Coupling coupling;
  coupling.bur_mass = c.mass;
  coupling.stiffness = c.stiffness;
  coupling.damping = c.damping;
  CouplingState s{Vec3::UnitX(), Vec3::Zero(), Vec3::Zero(), Vec3::Zero()};
  std::vector<double> x = {1};
  for (int i = 0; i < steps; ++i) {
    s.velocity = implicit_velocity(coupling, c.time_step, s, Mat3::Zero(), Vec3::Zero());
    s.position += c.time_step * s.velocity;
    x.push_back(s.position.x());
  }
  return x;
}

TEST(CouplingResponse, EightGramsOnOneNewtonPerMillimetreRingAt56Hz) {
  EXPECT_NEAR(free_air_frequency({kMass, 1, 0, 0}), std::sqrt(1 / kMass) / (2 * M_PI), 1e-9);
  EXPECT_NEAR(free_air_frequency({kMass, 1, 0, 0}), 56.27, 0.01);
}

TEST(CouplingResponse, ReleasedIsWhatTheStepsOfASessionGive) {
  for (const double k : {0.4, 1.0, 5.0})
    for (const double b : {0.0, 0.5e-3, 2.5e-3, 6e-3, 20e-3})
      for (const double h : {1e-3, 1e-4}) {
        const BurOnCoupling c{kMass, k, b, h};
        const int steps = static_cast<int>(std::lround(0.05 / h));
        const std::vector<double> x = stepped(c, steps);
        for (int n = 0; n <= steps; ++n)
          ASSERT_NEAR(released(c, n * h), x[static_cast<std::size_t>(n)], 1e-9)
              << k << " " << b << " " << h << " " << n;
      }
}

TEST(CouplingResponse, RemainingIsTheLargestFromThenOn) {
  for (const double k : {0.4, 1.0, 5.0})
    for (const double b : {0.0, 0.5e-3, 2.5e-3, 6e-3})
      for (const double h : {1e-3, 1e-4}) {
        const BurOnCoupling c{kMass, k, b, h};
        const std::vector<double> x = stepped(c, static_cast<int>(std::lround(0.3 / h)));
        double most = 0;
        for (auto n = static_cast<std::size_t>(std::lround(0.02 / h)); n < x.size(); ++n)
          most = std::max(most, std::abs(x[n]));
        EXPECT_NEAR(remaining(c, 0.02), most, 1e-9) << k << " " << b << " " << h;
      }
}

TEST(CouplingResponse, WithoutADamperTheDampingIsTheIntegratorsAndGoesWithTheStep) {
  // |z|^n = (1 + h² k/m)^(-n/2) bounds what is left: 31 % at 1 ms, 94 % at 0.05 ms, all of it at 0.
  EXPECT_LE(remaining({kMass, 1, 0, 1e-3}, 0.02), std::pow(1.125, -10.0) * 1.01);
  EXPECT_NEAR(remaining({kMass, 1, 0, 5e-5}, 0.02), std::pow(1 + 0.0025 / 8, -200.0), 0.03);
  EXPECT_DOUBLE_EQ(remaining({kMass, 1, 0, 0}, 0.02), 1);
}

TEST(CouplingResponse, StepsOfFirstOrderApproachTheEquation) {
  for (const double b : {0.5e-3, 2.5e-3, 4e-3}) {
    const double exact = released({kMass, 1, b, 0}, 0.01);
    const double coarse = released({kMass, 1, b, 2e-6}, 0.01) - exact;
    const double fine = released({kMass, 1, b, 1e-6}, 0.01) - exact;
    EXPECT_NEAR(coarse / fine, 2, 0.02) << b;
  }
}

TEST(CouplingResponse, CriticalDampingIsTheLimitFromBothSides) {
  const double critical = 2 * std::sqrt(kMass), rate = critical / 2 / kMass;
  for (const double near : {1 - 1e-9, 1.0, 1 + 1e-9})
    EXPECT_NEAR(released({kMass, 1, critical * near, 0}, 0.01),
                (1 + rate * 0.01) * std::exp(-rate * 0.01), 1e-6);
}

TEST(CouplingResponse, TheLeastDamperIsTheLeast) {
  const std::vector<double> steps = {1e-3, 1e-4, 0};
  for (const double k : {0.4, 0.8, 1.0}) {
    const double b = least_damping(kMass, k, steps, 0.02, 0.05);
    double most = 0, with_less = 0;
    for (const double h : steps) {
      most = std::max(most, remaining({kMass, k, b, h}, 0.02));
      with_less = std::max(with_less, remaining({kMass, k, b - 1e-6, h}, 0.02));
    }
    EXPECT_LE(most, 0.05);
    EXPECT_GT(with_less, 0.05);
  }
  EXPECT_TRUE(std::isnan(least_damping(kMass, 0.01, steps, 0.02, 0.05)));  // too slow a spring
}

TEST(CouplingResponse, TheHandFeelsSlowMotionWholeAndFastMotionNot) {
  const double B = 3;
  const BurOnCoupling c{kMass, 1, 2.5e-3, 0};
  EXPECT_NEAR(std::abs(rendered_share(c, B, 1e-6)), 1, 1e-4);
  const double corner = 1 / (2 * M_PI * B);  // k/B
  EXPECT_NEAR(std::norm(rendered_share({kMass, 1, 0, 0}, B, corner)), 0.5, 1e-3);
  // m and b small beside B: far above the corner b/(b + B) is left.
  EXPECT_NEAR(std::abs(rendered_share(c, B, 3000)), 2.5e-3 / (B + 2.5e-3), 0.02 * 2.5e-3 / B);
}

}  // namespace
}  // namespace toothprep::reference
