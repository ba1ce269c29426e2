// Steady forces against the closed forms for a bur fully in one tissue (R radius, L engaged length,
// v feed):
//
//                         F_feed                F_across        T
//   cylinder, side feed   u v L / (4 alpha N)   u v L / (4 N)   u v R L / (pi N)
//   ball, feed ⟂ axis     pi u v R / (8 alpha N)   u v R / (2 N)   u v R² / (2 N)
//   flat end, plunge      u v R / (alpha N)     0               u v R² / (2 N)
//
// They follow from dF = u/(2 pi N) (v·n)(n_t - n_n/alpha) dphi dl: with phi from the feed
// direction, int cos² = pi/2 and int cos = 2 over the advancing half of a cylinder; over half a
// sphere with polar angle theta, dl = R dtheta, v·n = v sin(theta) cos(phi), int sin² = pi/2.
#include <gtest/gtest.h>

#include "experiment.h"
#include "toothprep/step/core/units.h"

namespace toothprep::testing {
namespace {

using units::kPi;

struct Case {
  double u, alpha, rate, speed;
  Pose frame;
};

std::vector<Case> cases() {
  const Quat q1 = Quat(Eigen::AngleAxisd(0.4, Vec3(1, 2, 3).normalized()));
  const Quat q2 = Quat(Eigen::AngleAxisd(1.1, Vec3(-2, 1, 0.5).normalized()));
  return {{300, 0.25, 100, 0.5, {}},
          {100, 0.25, 100, 0.5, {Vec3(0.03, -0.02, 0.07), Quat::Identity()}},
          {300, 0.5, 80, 0.2, {Vec3(1, 2, 3), q1}},
          {700, 0.35, 100.3, 1.0, {Vec3(-5, 0.013, 2), q2}},
          {300, 0.25, 5000, 0.5, {Vec3::Zero(), Quat(Eigen::AngleAxisd(kPi / 4, Vec3::UnitX()))}}};
}

Parameters parameters_of(const Case& c) {
  Parameters p = paper_without_stall();
  p.tissue[tissue_index(Tissue::kEnamel)] = {c.u, c.alpha};
  p.handpiece.rotation_rate = c.rate;
  return p;
}

// The plateau of 0.8 mm of side feed along -y of the block's frame, started fully engaged.
Plateau side_feed(const Bur& bur, double tip_z, const Case& c, double voxel) {
  const LayeredTooth tooth = block(voxel, 6, Vec3(4, 6, 6), c.frame);
  const Outcome r = run(tooth, bur, parameters_of(c), Drive::kDirect,
                        straight_path({Vec3(0, -2, tip_z), Vec3(0, -3, tip_z)}, c.speed, c.frame));
  return plateau(r.rows, 0.8, c.frame);
}

constexpr double kTolerance = 0.01;

TEST(ClosedForms, CylinderInSideFeedWithin1Percent) {
  const double R = 0.6, L = 3;
  for (const Case& c : cases()) {
    const Plateau p = side_feed(paper_cylinder(), -1.5, c, 0.1);
    const double feed = c.u * c.speed * L / (4 * c.alpha * c.rate);
    const double across = c.u * c.speed * L / (4 * c.rate);
    const double torque = c.u * c.speed * R * L / (kPi * c.rate);
    EXPECT_NEAR(p.force.y() / feed, 1, kTolerance);    // feed is -y: the force resists along +y
    EXPECT_NEAR(p.force.x() / across, 1, kTolerance);  // clockwise: n_t = +phi^ is +x at the front
    EXPECT_NEAR(p.force.z() / feed, 0, kTolerance);
    EXPECT_NEAR(p.torque / torque, 1, kTolerance);
    std::printf(
        "cylinder u=%g alpha=%g N=%g v=%g: feed %.4f across %.4f torque %.4f of exact; rms %.2f "
        "%%\n",
        c.u, c.alpha, c.rate, c.speed, p.force.y() / feed, p.force.x() / across, p.torque / torque,
        100 * p.rms_force.y() / feed);
  }
}

TEST(ClosedForms, BallInSideFeedWithin1Percent) {
  const double R = 0.6;
  for (const Case& c : cases()) {
    const Plateau p = side_feed(paper_ball(), -0.6, c, 0.1);
    const double feed = kPi * c.u * c.speed * R / (8 * c.alpha * c.rate);
    const double across = c.u * c.speed * R / (2 * c.rate);
    const double torque = c.u * c.speed * R * R / (2 * c.rate);
    EXPECT_NEAR(p.force.y() / feed, 1, kTolerance);
    EXPECT_NEAR(p.force.x() / across, 1, kTolerance);
    EXPECT_NEAR(p.force.z() / feed, 0, kTolerance);
    EXPECT_NEAR(p.torque / torque, 1, kTolerance);
    std::printf(
        "ball u=%g alpha=%g N=%g v=%g: feed %.4f across %.4f torque %.4f of exact; rms %.2f %%\n",
        c.u, c.alpha, c.rate, c.speed, p.force.y() / feed, p.force.x() / across, p.torque / torque,
        100 * p.rms_force.y() / feed);
  }
}

TEST(ClosedForms, FlatEndInPlungeWithin1Percent) {
  const double R = 0.6;
  for (const Case& c : cases()) {
    const LayeredTooth tooth = block(0.1, 4, Vec3(4, 4, 6), c.frame);
    const Outcome r = run(tooth, paper_cylinder(), parameters_of(c), Drive::kDirect,
                          straight_path({Vec3(0, -2, 1), Vec3(0, -2, 0)}, c.speed, c.frame));
    const Plateau p = plateau(r.rows, 0.8, c.frame);
    const double axial = c.u * c.speed * R / (c.alpha * c.rate);
    const double torque = c.u * c.speed * R * R / (2 * c.rate);
    EXPECT_NEAR(p.force.z() / axial, 1, kTolerance);
    EXPECT_NEAR(p.force.x() / axial, 0, kTolerance);
    EXPECT_NEAR(p.force.y() / axial, 0, kTolerance);
    EXPECT_NEAR(p.torque / torque, 1, kTolerance);
    std::printf("plunge u=%g alpha=%g N=%g v=%g: axial %.4f torque %.4f of exact; rms %.2f %%\n",
                c.u, c.alpha, c.rate, c.speed, p.force.z() / axial, p.torque / torque,
                100 * p.rms_force.z() / axial);
  }
}

TEST(ClosedForms, PapersValuesAtHalfAMillimetrePerSecond) {
  // u = 0.3 J/mm³, alpha = 0.25, N = 100 rev/s, 0.5 mm/s: 4.500 N, 1.125 N, 0.8594 mN·m; dentin a
  // third.
  for (const double enamel : {6.0, 0.0}) {
    const double share = enamel > 0 ? 1 : 1.0 / 3;
    const LayeredTooth tooth = block(0.1, enamel, Vec3(4, 6, 6));
    const Outcome r = run(tooth, paper_cylinder(), paper_without_stall(), Drive::kDirect,
                          straight_path({Vec3(0, -2, -1.5), Vec3(0, -3, -1.5)}, 0.5));
    const Plateau p = plateau(r.rows, 0.8);
    EXPECT_NEAR(p.force.y(), share * 4.5, share * 0.045);
    EXPECT_NEAR(p.force.x(), share * 1.125, share * 0.01125);
    EXPECT_NEAR(p.torque, share * 0.8594, share * 0.008594);
  }
}

TEST(ClosedForms, CounterClockwiseBurMirrorsTheForceAcrossTheFeed) {
  Parameters p = paper_without_stall();
  p.handpiece.clockwise = false;
  const Outcome r = run(block(0.1, 6, Vec3(4, 6, 6)), paper_cylinder(), p, Drive::kDirect,
                        straight_path({Vec3(0, -2, -1.5), Vec3(0, -2.5, -1.5)}, 0.5));
  EXPECT_NEAR(plateau(r.rows, 0.8).force.x(), -1.125, 0.02);
}

TEST(ClosedForms, ForceIsProportionalToVelocityAndToSpecificEnergy) {
  // Doubling v at half the number of steps, or u, doubles the force at every place on the path.
  Case c{300, 0.25, 100, 0.5, {}};
  const Plateau base = side_feed(paper_ball(), -0.6, c, 0.1);
  Case faster = c, harder = c;
  faster.speed *= 2;
  harder.u *= 2;
  EXPECT_NEAR(side_feed(paper_ball(), -0.6, faster, 0.1).force.y() / base.force.y(), 2, 0.004);
  EXPECT_NEAR(side_feed(paper_ball(), -0.6, harder, 0.1).force.y() / base.force.y(), 2, 1e-5);
}

}  // namespace
}  // namespace toothprep::testing
