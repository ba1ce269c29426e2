// The exact load on straight feed against closed forms, hand-derived partial contacts, brute force,
// conservation of energy and invariances.
#include <gtest/gtest.h>

#include <boost/math/quadrature/gauss_kronrod.hpp>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <vector>

#include "toothprep/proof/reference/closed_forms.h"
#include "toothprep/proof/reference/straight_feed.h"
#include "toothprep/step/bur/bur_shapes.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep::reference {
namespace {

using units::kPi;

constexpr int kEnamel = tissue_index(Tissue::kEnamel), kDentin = tissue_index(Tissue::kDentin);
constexpr Grinding kLaw{300, 0.25, 100};  // enamel of the preset `paper`
// The quadrature's own tolerance is 1e-9; contacts with smooth integrands reach rounding.
constexpr double kTight = 1e-9;

Scene scene_of(const std::string& bur, const Block& block = {}) {
  return make_scene(bur_from_shorthand(bur), block, preset_parameters("paper"));
}
Pose at(double x, double y, double z) { return {Vec3(x, y, z), Quat::Identity()}; }

void expect_near(const Vec3& a, const Vec3& b, double tolerance) {
  EXPECT_NEAR(a.x(), b.x(), tolerance);
  EXPECT_NEAR(a.y(), b.y(), tolerance);
  EXPECT_NEAR(a.z(), b.z(), tolerance);
}

// ---- Wholly in one tissue.

TEST(StraightFeed, CylinderAndBallInAnyDirectionAcrossTheAxisMeetTheClosedForms) {
  for (const double angle : {0.0, 0.3, 1.5707963267948966, 2.0, -1.1}) {
    const Vec3 v = 0.5 * Vec3(std::cos(angle), std::sin(angle), 0);
    const Vec3 side = Vec3::UnitZ().cross(v).normalized();
    for (const bool clockwise : {true, false}) {
      Scene cylinder = scene_of("cylinder:D1.2xL3.0"), ball = scene_of("ball:D1.2");
      cylinder.clockwise = ball.clockwise = clockwise;
      const double sense = clockwise ? 1 : -1;
      const SteadyLoad c = cylinder_side_feed(kLaw, 0.6, 3, 0.5),
                       b = ball_side_feed(kLaw, 0.6, 0.5);
      const Load lc = load(cylinder, at(0, -1, -1), v), lb = load(ball, at(0, -1, -1), v);
      expect_near(lc.force, -c.against * v / 0.5 + sense * c.across * side, kTight);
      expect_near(lb.force, -b.against * v / 0.5 + sense * b.across * side, kTight);
      EXPECT_NEAR(lc.torque, c.torque, kTight);
      EXPECT_NEAR(lb.torque, b.torque, kTight);
      EXPECT_NEAR(lc.area[kEnamel], kPi * 0.6 * 3, kTight);        // half the side
      EXPECT_NEAR(lb.area[kEnamel], 2 * kPi * 0.6 * 0.6, kTight);  // half the sphere
      EXPECT_EQ(lc.area[kDentin], 0);
    }
  }
}

TEST(StraightFeed, ClockwiseBurFedAlongMinusYIsPushedAlongPlusX) {
  // -phi^ is the way the surface of a clockwise bur moves (seen from the shank); at the front, phi
  // = -90 degrees, n_t = +phi^ = +x.
  EXPECT_GT(load(scene_of("cylinder:D1.2xL3.0"), at(0, -1, 0), {0, -0.5, 0}).force.x(), 0);
}

TEST(StraightFeed, PlungingFlatEndMeetsTheClosedForm) {
  const SteadyLoad p = flat_end_plunge(kLaw, 0.6, 0.5);
  const Load l = load(scene_of("cylinder:D1.2xL3.0"), at(0, -1, 0), {0, 0, -0.5});
  expect_near(l.force, {0, 0, p.against}, kTight);
  EXPECT_NEAR(l.torque, p.torque, kTight);
  EXPECT_NEAR(l.area[kEnamel], kPi * 0.36, kTight);
}

TEST(StraightFeed, DentinTakesAThird) {
  const Scene s = scene_of("ball:D1.2");
  const Vec3 v(0, -0.5, 0);
  const Load enamel = load(s, at(0, -1, 0), v), dentin = load(s, at(0, -4, 0), v);
  expect_near(dentin.force, enamel.force / 3, kTight);
  EXPECT_NEAR(dentin.torque, enamel.torque / 3, kTight);
  EXPECT_NEAR(dentin.area[kDentin], enamel.area[kEnamel], kTight);
}

TEST(StraightFeed, NothingWithoutContactMotionOrAdvance) {
  const Scene s = scene_of("cylinder:D1.2xL3.0");
  EXPECT_EQ(load(s, at(0, 1, 0), {0, -0.5, 0}).torque, 0);          // above the block
  EXPECT_EQ(load(s, at(0, 0.6, 0), {0, -0.5, 0}).torque, 0);        // just touching
  EXPECT_EQ(load(s, at(0, -1, 0), Vec3::Zero()).area[kEnamel], 0);  // at rest
  EXPECT_EQ(load(s, at(0, -1, 0), {0, std::nan(""), 0}).torque, 0);
  EXPECT_EQ(load(s, at(0, 0, 0), {0, 0.5, 0}).area[kEnamel], 0);  // only the rear is in
  // A flat end that moves in its own plane, but for a rounded velocity.
  const Scene flat = scene_of("cylinder:D1.2xL3.0");
  EXPECT_NEAR(load(flat, at(0, -1, 0), {0, -0.5, -1e-13}).area[kEnamel], kPi * 1.8, kTight);
}

// ---- Partial contacts, by hand.

TEST(StraightFeed, ForceAndAreaOfACylinderGoAsItsEngagedLength) {
  const Scene s = scene_of("cylinder:D1.2xL3.0");
  const Vec3 v(0, -0.5, 0);
  const Load full = load(s, at(0, -1, 0), v);
  struct Case {
    double z, length;
  };
  // The block reaches from z = -4 to 4; the head from the tip up by 3.
  for (const Case c : {Case{2.5, 1.5}, {3.9, 0.1}, {-5, 2}, {-6.75, 0.25}, {1, 3}, {4, 0}}) {
    const Load l = load(s, at(0, -1, c.z), v);
    expect_near(l.force, full.force * c.length / 3, kTight);
    EXPECT_NEAR(l.torque, full.torque * c.length / 3, kTight);
    EXPECT_NEAR(l.area[kEnamel], kPi * 0.6 * c.length, kTight);
  }
}

TEST(StraightFeed, CylinderEnteringAFaceGrindsOverTheAngleThatIsIn) {
  // With its axis at height y > 0 over the face the front is in for |psi| < theta about -y,
  // cos(theta) = y / R: v·n = v cos(psi), so that with c = u v L / (2 pi N)
  //   F_y = c / alpha (theta + sin theta cos theta), F_x = alpha F_y, T = 2 c R sin theta.
  const Scene s = scene_of("cylinder:D1.2xL3.0");
  const double c = 300 * 0.5 * 3 / (2 * kPi * 100), r = 0.6;
  for (const double y : {0.599999, 0.59, 0.4, 0.1, 0.0}) {
    const double theta = std::acos(y / r), spread = theta + std::sin(theta) * std::cos(theta);
    const Load l = load(s, at(0, y, 0), {0, -0.5, 0});
    expect_near(l.force, {c * spread, 4 * c * spread, 0}, kTight);
    EXPECT_NEAR(l.torque, 2 * c * r * std::sin(theta), kTight);
    EXPECT_NEAR(l.area[kEnamel], 2 * theta * r * 3, kTight);
  }
}

TEST(StraightFeed, CylinderHalfBesideTheBlock) {
  // Axis in the face x = 4, so that the quarter with n_x < 0 grinds: n = (-sin psi, -cos psi), n_t
  // = (cos psi, -sin psi), psi from 0 to 90 degrees. Integrals of cos² and sin cos: pi/4 and 1/2.
  const Load l = load(scene_of("cylinder:D1.2xL3.0"), at(4, -1, 0), {0, -0.5, 0});
  const double c = 300 * 0.5 * 3 / (2 * kPi * 100), alpha = 0.25;
  expect_near(l.force, {c * (kPi / 4 + 0.5 / alpha), c * (-0.5 + kPi / 4 / alpha), 0}, kTight);
  EXPECT_NEAR(l.torque, c * 0.6, kTight);
  EXPECT_NEAR(l.area[kEnamel], kPi / 2 * 0.6 * 3, kTight);
}

TEST(StraightFeed, BallHalfOutOfTheBlocksEnd) {
  // Centre in the face z = 4: the lower half grinds, half of everything across; and along the axis
  // -n_z / alpha pushes it out: u v R / (2 pi N alpha) times the integrals of cos sin (1/2) over
  // the latitude and of cos (2) around.
  const Scene s = scene_of("ball:D1.2");
  const Load l = load(s, at(0, -1, 4 - 0.6), {0, -0.5, 0});
  const SteadyLoad b = ball_side_feed(kLaw, 0.6, 0.5);
  const double out = 300 * 0.5 * 0.6 / (2 * kPi * 100 * 0.25);
  expect_near(l.force, {b.across / 2, b.against / 2, out}, kTight);
  EXPECT_NEAR(l.torque, b.torque / 2, kTight);
}

TEST(StraightFeed, TissueBorderThroughTheMiddleTakesTheMeanAndAStep) {
  // Feed along x with the axis in the border: n = (cos phi, sin phi), n_t = (-sin phi, cos phi),
  // phi from 0 to 90 degrees in enamel, from -90 to 0 in dentin. With c_k = u_k v L / (2 pi N) and
  // the integrals of cos² and sin cos over a quarter, pi/4 and 1/2,
  //   F_x = sum of c_k (-pi/4 / alpha_k -+ 1/2), F_y = sum of c_k (pi/4 -+ 1/2 / alpha_k):
  // the mean of both plateaus, and a step from the parts that no longer cancel. T is the mean.
  for (const double alpha : {0.25, 0.5}) {  // of dentin; enamel keeps 0.25
    Scene s = scene_of("cylinder:D1.2xL3.0");
    s.dentin.force_ratio = alpha;
    const SteadyLoad e = cylinder_side_feed(kLaw, 0.6, 3, 0.5);
    const SteadyLoad d = cylinder_side_feed({100, alpha, 100}, 0.6, 3, 0.5);
    const Load l = load(s, at(0, -2, 0), {0.5, 0, 0});
    const double ce = 300 * 0.5 * 3 / (2 * kPi * 100), cd = ce / 3;
    expect_near(l.force,
                {-(e.against + d.against) / 2 - (ce - cd) / 2,
                 (e.across + d.across) / 2 - (ce / 0.25 - cd / alpha) / 2, 0},
                kTight);
    EXPECT_NEAR(l.torque, (e.torque + d.torque) / 2, kTight);
    EXPECT_NEAR(l.area[kEnamel], l.area[kDentin], kTight);
  }
}

// ---- Any orientation, any contact.

// Midpoint sums over the surface, independent of every break point. First order at the borders of
// the contact: with 1500 x 1500 points the error is about 1/1500 of one row of elements.
Load brute_force(const Scene& s, const Pose& bur, const Vec3& v, int n) {
  Load out;
  const Vec3 half = s.block.size / 2;
  for (const ProfilePiece& piece : s.profile) {
    if (!piece.grinds) continue;
    const double dl = length_of(piece) / n, dphi = 2 * kPi / n;
    for (int i = 0; i < n; ++i) {
      const ProfilePoint p = point_on(piece, (i + 0.5) / n);
      for (int j = 0; j < n; ++j) {
        const double phi = (j + 0.5) * dphi;
        const Vec3 radial(std::cos(phi), std::sin(phi), 0);
        const Vec3 normal = bur.orientation * (p.along_z * radial - p.along_r * Vec3::UnitZ());
        const double feed = v.dot(normal);
        if (feed <= 0) continue;
        const Vec3 x = bur.to_world(p.r * radial + p.z * Vec3::UnitZ());
        if (x.y() > 0 || x.y() < -s.block.size.y() || std::abs(x.x()) > half.x() ||
            std::abs(x.z()) > half.z())
          continue;
        const int k = x.y() > -s.block.enamel ? kEnamel : kDentin;
        const GrindingProperties& law = k == kEnamel ? s.enamel : s.dentin;
        const double power = law.specific_energy / (2 * kPi * s.rotation_rate) * feed * dphi * dl;
        const Vec3 tangent = bur.orientation * Vec3(-radial.y(), radial.x(), 0);
        out.force += power * (tangent - normal / law.force_ratio);
        out.torque += power * p.r;
        out.area[static_cast<std::size_t>(k)] += p.r * dphi * dl;
      }
    }
  }
  return out;
}

TEST(StraightFeed, TiltedBursAtEdgesAndBordersAgreeWithBruteForce) {
  struct Case {
    const char* bur;
    Vec3 axis, tip, velocity;
  };
  const Block block{{3, 3, 2}, 0.7};
  for (const Case& c :
       {Case{"cylinder:D1.2xL3.0", {0.3, 0.8, 0.5}, {0.2, -0.9, -0.3}, {0.3, -0.4, 0.1}},
        Case{"ball:D1.2", {0.1, 1, 0.2}, {1.3, -0.8, 0.9}, {0.2, -0.3, 0.3}},
        Case{"pear:D1.2xL2.0xN0.8", {-0.4, 0.2, 1}, {-1.3, -0.3, -0.9}, {-0.3, -0.2, -0.4}},
        Case{"flame:D1.2xL3.0", {0.5, 0.5, 0.2}, {-0.9, -1.2, 0.6}, {-0.2, -0.5, 0.1}},
        Case{"inverted-cone:D1.2xL1.0xN0.8", {0, 1, 0}, {0.8, -1.2, 0.7}, {0.5, -0.1, 0.2}}}) {
    const Scene s = scene_of(c.bur, block);
    const Pose pose{c.tip, orientation_of_axis(c.axis)};
    const Load exact = load(s, pose, c.velocity), sum = brute_force(s, pose, c.velocity, 1000);
    const double scale = exact.force.norm();
    EXPECT_GT(exact.area[kEnamel], 0.01) << c.bur;
    EXPECT_GT(exact.area[kDentin], 0.01) << c.bur;
    expect_near(exact.force, sum.force, 5e-4 * scale);
    EXPECT_NEAR(exact.torque, sum.torque, 5e-4 * scale);
    EXPECT_NEAR(exact.area[kEnamel], sum.area[kEnamel], 2e-3);
    EXPECT_NEAR(exact.area[kDentin], sum.area[kDentin], 2e-3);
  }
}

TEST(StraightFeed, TurningAllAboutTheVerticalTurnsTheForce) {
  // Only the top face and the border are near: both are unchanged by a turn about y, while the
  // bur's axis leaves +z, so that the general branch answers.
  const Quat turn(Eigen::AngleAxisd(0.7, Vec3::UnitY()));
  for (const char* bur :
       {"cylinder:D1.2xL3.0", "ball:D1.2", "flame:D1.2xL3.0", "cone:D1.2xL3xT0.4"})
    for (const double y : {0.3, -0.2, -1.9}) {
      const Scene s = scene_of(bur, {{40, 8, 40}, 2});
      const Vec3 v(0.1, -0.5, -0.2);
      const Load plain = load(s, at(0, y, 0), v);
      const Load turned = load(s, {Vec3(0, y, 0), turn}, turn * v);
      expect_near(turned.force, turn * plain.force, kTight * 10);
      EXPECT_NEAR(turned.torque, plain.torque, kTight * 10);
    }
}

TEST(StraightFeed, TighterToleranceChangesNothingThatCounts) {
  for (const char* bur :
       {"cylinder:D1.2xL3.0", "ball:D1.2", "pear:D1.2xL2.0xN0.8", "flame:D1.2xL3.0"})
    for (const Vec3& axis : {Vec3(0, 0, 1), Vec3(0.2, 0.9, 0.4)})
      for (double y = 0.7; y > -3; y -= 0.09) {
        Scene s = scene_of(bur);
        const Pose pose{{0, y, 2.6}, orientation_of_axis(axis)};
        const Vec3 v(0.1, -0.5, 0.2);
        const Load usual = load(s, pose, v);
        s.tolerance = 1e-12;
        const Load tight = load(s, pose, v);
        EXPECT_LT((usual.force - tight.force).norm(), 1e-8) << bur << " " << y;
        EXPECT_NEAR(usual.torque, tight.torque, 1e-8);
      }
}

// ---- Energy and power.

// Integral of f between the given points, smooth but for square roots at them.
template <class F>
double integral(const F& f, std::vector<double> points) {
  double sum = 0;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const double mean = (points[i] + points[i + 1]) / 2, half = (points[i + 1] - points[i]) / 2;
    sum += boost::math::quadrature::gauss_kronrod<double, 31>::integrate(
        [&](double t) { return half * std::sin(t) * f(mean - half * std::cos(t)); }, 0.0, kPi, 5,
        1e-10);
  }
  return sum;
}

TEST(StraightFeed, WorkOfTheTorqueIsTheEnergyOfWhatIsSwept) {
  // From above the block to below it: 2 pi N T integrated over time is u times the volume swept in
  // each layer: 2 R L per mm for the cylinder, pi R² / |cos| for the ball, whose path may be
  // oblique.
  const Block block{{8, 5, 8}, 2};
  const double r = 0.6, layers = 300 * 2 + 100 * 3;
  struct Case {
    const char* bur;
    Vec3 velocity;
    double section;
  };
  const Vec3 oblique(0.2, -0.4, -0.15);
  for (const Case& c : {Case{"cylinder:D1.2xL3.0", {0, -0.5, 0}, 2 * r * 3},
                        Case{"ball:D1.2", {0, -0.5, 0}, kPi * r * r},
                        Case{"ball:D1.2", oblique, kPi * r * r * oblique.norm() / 0.4}}) {
    const Scene s = scene_of(c.bur, block);
    const double down = -c.velocity.y();
    const Vec3 middle(0, -2.5, 0);
    const auto power = [&](double height) {  // per mm of descent
      const Vec3 tip = middle + c.velocity / down * (-2.5 - height);
      return 2 * kPi * 100 * load(s, {tip, Quat::Identity()}, c.velocity).torque / down;
    };
    // Contact changes where the front's ends pass a plane. Oblique: the silhouette's height, too.
    const double low = r * std::sqrt(1 - std::pow(down / c.velocity.norm(), 2));
    std::vector<double> points;
    for (const double plane : {-5.0, -2.0, 0.0})
      for (const double over : {-r, -low, low, r})
        if (points.empty() || plane + over > points.back() + 1e-9) points.push_back(plane + over);
    const double work = integral(power, points);
    EXPECT_NEAR(work / (layers * c.section), 1, 1e-7) << c.bur;
  }
}

TEST(StraightFeed, PowerIsTheSpecificEnergyTimesTheVolumeRate) {
  for (const char* bur : {"ball:D1.2", "pear:D1.2xL2.0xN0.8"})
    for (const double y : {0.2, -1.0, -1.8, -2.3}) {
      const Load l =
          load(scene_of(bur), {{3.8, y, 0}, orientation_of_axis({0.2, 0.1, 1})}, {0.2, -0.4, 0.1});
      EXPECT_NEAR(2 * kPi * 100 * l.torque,
                  300 * l.volume_rate[kEnamel] + 100 * l.volume_rate[kDentin], 1e-9);
      EXPECT_GE(l.volume_rate[kEnamel], 0);
      EXPECT_GE(l.volume_rate[kDentin], 0);
    }
}

TEST(StraightFeed, DragIsTheForcesDerivativeByVelocity) {
  // The border of the advancing half moves with v, but the integrand is zero there.
  const Scene s = scene_of("pear:D1.2xL2.0xN0.8");
  const Pose pose{{0.3, -0.1, 0}, orientation_of_axis({0.3, 0.5, 1})};
  const Vec3 v(0.2, -0.4, 0.1);
  const Engagement e = engagement(s, pose, v);
  const double h = 1e-5;
  for (int a = 0; a < 3; ++a) {
    const Vec3 d = h * Vec3::Unit(a);
    const Load more = load(s, pose, v + d), less = load(s, pose, v - d);
    expect_near((more.force - less.force) / (2 * h), e.drag.col(a), 1e-6);
    EXPECT_NEAR((more.torque - less.torque) / (2 * h), e.torque[a], 1e-6);
  }
}

TEST(StraightFeed, ScalesAsTheLawSays) {
  const Scene s = scene_of("pear:D1.2xL2.0xN0.8", {{4, 3, 4}, 1});
  const Pose pose{{0.3, -0.8, 0.9}, orientation_of_axis({0.3, 0.1, 1})};
  const Vec3 v(0.2, -0.4, 0.1);
  const Load base = load(s, pose, v);
  expect_near(load(s, pose, 3 * v).force, 3 * base.force, kTight);
  Scene hard = s;
  hard.enamel.specific_energy *= 2;
  hard.dentin.specific_energy *= 2;
  expect_near(load(hard, pose, v).force, 2 * base.force, kTight);
  Scene fast = s;
  fast.rotation_rate *= 2;
  EXPECT_NEAR(load(fast, pose, v).torque, base.torque / 2, kTight);
  // All lengths doubled: dphi dl doubles, the torque's arm too.
  const Scene large = scene_of("pear:D2.4xL4.0xN1.6", {{8, 6, 8}, 2});
  const Load twice = load(large, {2 * pose.position, pose.orientation}, v);
  expect_near(twice.force, 2 * base.force, 1e-8);
  EXPECT_NEAR(twice.torque, 4 * base.torque, 1e-8);
  EXPECT_NEAR(twice.area[kEnamel], 4 * base.area[kEnamel], 1e-8);
}

// ---- Paths.

TEST(StraightFeed, APathIsItsRows) {
  const Scene s = scene_of("ball:D1.2");
  std::vector<PathRow> path;
  for (int i = 0; i < 4000; ++i)  // entry, plateau, border; the speed grows
    path.push_back({i * 1e-3, at(0, 0.8 - i * 1e-3, 0), Vec3(0, -1e-3 * (i + 1), 0)});
  const std::vector<Load> rows = load_along(s, path), again = load_along(s, path);
  for (std::size_t i = 0; i < path.size(); i += 7) {
    const Load alone = load(s, path[i].bur, path[i].velocity);
    expect_near(rows[i].force, alone.force, kTight);
    EXPECT_NEAR(rows[i].torque, alone.torque, kTight);
    EXPECT_EQ(rows[i].force, again[i].force);
  }
  EXPECT_TRUE(load_along(s, {}).empty());
}

TEST(StraightFeed, ContactShapeChangesWhereTheLoadHasAKink) {
  // A ball that descends: first touch at 0.6, dentin touched at -2 + 0.6, enamel left at -2.
  const Scene s = scene_of("ball:D1.2");
  const auto shape = [&](double y) { return contact_shape(s, at(0, y, 0), {0, -0.5, 0}); };
  for (const double y : {0.6, -1.4, -2.0}) EXPECT_NE(shape(y + 1e-6), shape(y - 1e-6)) << y;
  EXPECT_EQ(shape(0.5), shape(0.1));
  EXPECT_EQ(shape(-0.7), shape(-1.3));
  EXPECT_EQ(shape(-1.5), shape(-1.9));
}

TEST(StraightFeed, RefusesBlocksThatAreNone) {
  const Bur bur = bur_from_shorthand("ball:D1.2");
  const Parameters p = preset_parameters("paper");
  EXPECT_THROW(make_scene(bur, {{0, 8, 8}, 2}, p), Error);
  EXPECT_THROW(make_scene(bur, {{8, 8, std::numeric_limits<double>::infinity()}, 2}, p), Error);
  EXPECT_THROW(make_scene(bur, {{8, 8, 8}, 9}, p), Error);
  EXPECT_THROW(make_scene(bur, {{8, 8, 8}, std::nan("")}, p), Error);
}

}  // namespace
}  // namespace toothprep::reference
