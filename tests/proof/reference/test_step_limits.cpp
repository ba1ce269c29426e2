// Limits of integration: the roots of the recurrences, found by power iteration of their matrices.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>

#include "toothprep/proof/reference/step_limits.h"

namespace toothprep::reference {
namespace {

constexpr double kMass = 8e-6, kStep = 1e-3;  // 8 g, 1 ms

double largest_root(const Eigen::MatrixXd& step) {
  return Eigen::EigenSolver<Eigen::MatrixXd>(step).eigenvalues().cwiseAbs().maxCoeff();
}

// The state (x, v) of a bur on its spring, one step later.
Eigen::MatrixXd euler(double k, double b, bool semi_implicit) {
  Eigen::Matrix2d step;
  step << 1, kStep, -kStep * k / kMass, 1 - kStep * b / kMass;
  if (semi_implicit) step.row(0) += kStep * step.row(1) - Eigen::RowVector2d(0, kStep);
  return step;
}

TEST(StepLimits, ExplicitEulerIsStableWithinItsRangeOnly) {
  for (const double k : {0.3, 1.0, 5.0}) {
    const StableRange r = explicit_euler_range(kMass, k, kStep);
    EXPECT_GT(largest_root(euler(k, 0, false)), 1) << "a bur in the air swings up";
    EXPECT_GT(largest_root(euler(k, 0.999 * r.low, false)), 1);
    EXPECT_LT(largest_root(euler(k, 1.001 * r.low, false)), 1);
    EXPECT_LT(largest_root(euler(k, 0.999 * r.high, false)), 1);
    EXPECT_GT(largest_root(euler(k, 1.001 * r.high, false)), 1);
  }
}

TEST(StepLimits, SemiImplicitEulerIsStableUpToItsLimit) {
  for (const double k : {0.3, 1.0, 5.0}) {
    const StableRange r = semi_implicit_euler_range(kMass, k, kStep);
    EXPECT_LT(largest_root(euler(k, 1e-3 * r.high, true)), 1);
    EXPECT_LT(largest_root(euler(k, 0.999 * r.high, true)), 1);
    EXPECT_GT(largest_root(euler(k, 1.001 * r.high, true)), 1);
  }
}

TEST(StepLimits, AToothIsHundredsOfTimesBeyondThem) {
  // 4 N·s/mm against 2 m/h = 0.016.
  EXPECT_GT(4 / explicit_euler_range(kMass, 1, kStep).high, 200);
}

TEST(StepLimits, AFilterDoesNotMoveTheLimitOfDirectRendering) {
  constexpr double kArm = 45e-6;  // 45 g
  const double limit = filtered_rendering_limit(kArm, kStep);
  for (const double a : {0.0, 0.5, 0.9, 0.99}) {
    const auto loop = [&](double b) {
      // State (v, v of a tick ago, y): y+ = a y + (1-a)(v + v-)/2, v+ = v - B T/M y+.
      const double g = b * kStep / kArm;
      Eigen::Matrix3d step;
      step << 1 - g * (1 - a) / 2, -g * (1 - a) / 2, -g * a,  //
          1, 0, 0,                                            //
          (1 - a) / 2, (1 - a) / 2, a;
      return largest_root(step);
    };
    EXPECT_LT(loop(0.999 * limit), 1) << a;
    EXPECT_GT(loop(1.001 * limit), 1) << a;
  }
}

TEST(StepLimits, AFilterDelaysByTheTimeOfItsCutoff) {
  // 1/(2 pi f) and half a tick: 53.1 ms at 3 Hz.
  EXPECT_NEAR(filter_delay(3, kStep), 1 / (2 * M_PI * 3) + kStep / 2, 1e-5);
}

}  // namespace
}  // namespace toothprep::reference
