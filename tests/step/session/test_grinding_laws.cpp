// Laws beyond the paper's (step/grinding/grinding_law.h) in whole sessions: forces against their
// integrals over the front of a cylinder, imposed loads, droop, the coupling, and the energy audit.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "experiment.h"
#include "toothprep/proof/reference/closed_forms.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/session/handpiece.h"

namespace toothprep::testing::laws {
namespace {

using units::kPi;

constexpr double kR = 0.6, kL = 3;  // of the cylinder, wholly engaged

reference::SteadyLoad in_slot(const GrindingProperties& t, double rate, double v) {
  return reference::cylinder_by_law(t, rate, kR, kL, v);
}

struct Law {
  const char* name;
  GrindingProperties tissue;
};

// Chips of 1 to 10 µm: 0.1 to 1 mm/s at 100 rev/s.
std::vector<Law> laws() {
  GrindingProperties size{300, 0.25}, ratio{300, 0.25}, rubbing{300, 0.25}, up{300, 0.25};
  size.size_exponent = 0.4, size.reference_chip = 5e-3;
  ratio.ratio_exponent = 0.3, ratio.reference_chip = 2e-3;
  rubbing.rubbing_pressure = 0.4, rubbing.reference_chip = 5e-3;
  up.up_cutting = 0.4;
  GrindingProperties all = size;
  all.ratio_exponent = -0.2, all.rubbing_pressure = 0.3, all.rubbing_friction = 0.5;
  all.up_cutting = -0.3;
  return {{"size effect", size},
          {"ratio", ratio},
          {"rubbing", rubbing},
          {"up-cutting", up},
          {"all of them", all}};
}

Parameters with(const GrindingProperties& tissue) {
  Parameters p = paper_without_stall();
  for (GrindingProperties& t : p.tissue) t = tissue;
  return p;
}

Outcome slot(const Parameters& p, Drive drive, double speed, double way = 1, double voxel = 0.1) {
  const LayeredTooth tooth = block(voxel, 6, Vec3(4, 6, 6));
  return run(tooth, paper_cylinder(), p, drive,
             straight_path({Vec3(0, -1.5, -1.5), Vec3(0, -1.5 - way, -1.5)}, speed));
}

TEST(GrindingLaws, ForceOfAFullSlotIsTheLawsIntegral) {
  for (const Law& law : laws())
    for (const double v : {0.1, 0.5}) {
      const reference::SteadyLoad exact = in_slot(law.tissue, 100, v);
      const Plateau p = plateau(slot(with(law.tissue), Drive::kDirect, v, 0.6).rows, 0.7);
      EXPECT_NEAR(p.force.y() / exact.against, 1, 0.01) << law.name << " " << v;
      EXPECT_NEAR((p.force.x() - exact.across) / exact.against, 0, 0.01) << law.name << " " << v;
      EXPECT_NEAR(p.torque / exact.torque, 1, 0.01) << law.name << " " << v;
      std::printf("%-12s v=%g: feed %.4f torque %.4f of exact, across off by %.4f of feed\n",
                  law.name, v, p.force.y() / exact.against, p.torque / exact.torque,
                  (p.force.x() - exact.across) / exact.against);
    }
}

TEST(GrindingLaws, ForceOfAFullSlotConvergesWithTheElements) {
  const GrindingProperties t = laws().back().tissue;
  const reference::SteadyLoad exact = in_slot(t, 100, 0.5);
  double last = 1;
  for (const double size : {0.15, 0.075, 0.0375}) {
    const Outcome r = run(block(0.05, 6, Vec3(4, 6, 6)), paper_cylinder(), with(t), Drive::kDirect,
                          straight_path({Vec3(0, -1.5, -1.5), Vec3(0, -1.8, -1.5)}, 0.5), size);
    const double error = std::abs(plateau(r.rows, 0.5).torque / exact.torque - 1);
    std::printf("elements of 2 x %g mm: torque off by %.2e\n", size, error);
    EXPECT_LT(error, std::max(last, 1e-4));
    last = error;
  }
  EXPECT_LT(last, 2e-3);
}

TEST(GrindingLaws, TheEnergyAuditHolds) {
  for (const Law& law : laws())
    for (const Bur& bur : {paper_cylinder(), paper_ball()})
      for (const Drive drive : {Drive::kDirect, Drive::kCoupled}) {
        const Parameters p = with(law.tissue);
        // In from outside, slantwise, and along and down.
        const Outcome r =
            run(block(0.1, 6, Vec3(5, 6, 5)), bur, p, drive,
                straight_path({Vec3(0, 0.8, -1), Vec3(0.4, -1, -1), Vec3(1.4, -1, -1.5)}, 0.8));
        EXPECT_NEAR(r.energy_ratio(p), 1, 0.02) << law.name << " " << bur.name();
        EXPECT_EQ(r.totals.unsettled_steps, 0) << law.name << " " << bur.name();
        std::printf("%-12s %s %s: audit %.4f, rubbing %.3f of the work\n", law.name,
                    bur.name().c_str(), name_of(drive), r.energy_ratio(p),
                    r.totals.rubbing_work / r.totals.torque_work);
      }
}

// The power that cuts is u (h/h0)^-m s ds: so the mean over the slot's front is known.
TEST(GrindingLaws, MeanSpecificEnergyOfASlotIsTheClosedForm) {
  GrindingProperties t{300, 0.25};
  t.size_exponent = 0.4, t.reference_chip = 5e-3;
  const double v = 0.5, m = t.size_exponent;
  const Outcome r = slot(with(t), Drive::kDirect, v);
  // int cos^(1-m) over the front / int cos, times the u at the front's chip.
  const double mean = t.specific_energy * std::pow(v / 100 / t.reference_chip, -m) *
                      std::sqrt(kPi) * std::tgamma((2 - m) / 2) / std::tgamma((3 - m) / 2) / 2;
  EXPECT_NEAR(r.totals.cutting_work[0] / r.totals.swept[0] / mean, 1, 0.003);
  EXPECT_NEAR(r.totals.swept[0] / r.totals.removed[0], 1, 0.02);
}

// The feed under an imposed load, by bisection of the integral.
double feed_under(const GrindingProperties& t, double rate, double load) {
  double low = 1e-7, high = 50;
  for (int i = 0; i < 80; ++i) {
    const double middle = std::sqrt(low * high);
    (in_slot(t, rate, middle).against < load ? low : high) = middle;
  }
  return low;
}

std::vector<HandleSample> pushed(double load, double seconds) {
  std::vector<HandleSample> path;
  for (int i = 0; i <= std::lround(seconds * 1000); ++i) {
    HandleSample s;
    s.time = i * 1e-3;
    s.pose.position = Vec3(0, -1, -1.5);
    s.load = Vec3(0, -load, 0);
    path.push_back(s);
  }
  return path;
}

Outcome pushed_slot(Parameters p, double load, double seconds) {
  p.load.rail = {0, -1, 0};
  return run(block(0.1, 8, Vec3(4, 8, 6)), paper_cylinder(), p, Drive::kLoad,
             pushed(load, seconds));
}

TEST(GrindingLaws, FeedUnderALoadIsThatOfTheIntegral) {
  for (const Law& law : laws())
    for (const double load : {1.0, 4.0}) {
      const double exact = feed_under(law.tissue, 100, load);
      const double seconds = std::min(2.0, 2 / exact);
      const Outcome r = pushed_slot(with(law.tissue), load, seconds);
      const StepRecord &a = r.rows[r.rows.size() / 2], &b = r.rows.back();
      const double v = (b.bur.position - a.bur.position).norm() / (b.handle.time - a.handle.time);
      EXPECT_NEAR(v / exact, 1, 0.02) << law.name << " " << load;
      EXPECT_NEAR(b.grinding_force.y(), load, 1e-4 * load) << law.name << " " << load;
      EXPECT_EQ(r.totals.unsettled_steps, 0) << law.name << " " << load;
      std::printf("%-12s %g N: %.4f mm/s, %.4f of exact\n", law.name, load, v, v / exact);
    }
}

// p times the projected front, 2 R L, is what rubs: with less the bur creeps by chips of less than
// h0/100 on the mean, with more it cuts.
TEST(GrindingLaws, BelowTheRubbingForceABurCreeps) {
  GrindingProperties t{300, 0.25};
  t.rubbing_pressure = 0.4, t.reference_chip = 1e-3;
  const double threshold = t.rubbing_pressure * 2 * kR * kL;
  const auto speed = [&](double load) {
    return pushed_slot(with(t), load, 0.3).rows.back().bur_velocity.norm();
  };
  const double creep = feed_under(t, 100, 0.5 * threshold);
  EXPECT_LT(creep, 1.5 * 100 * t.reference_chip / 100);
  EXPECT_NEAR(speed(0.5 * threshold) / creep, 1, 0.02);
  // Beyond it what is left over cuts as the paper has it.
  const double left = 0.8 * threshold, v = left * 4 * 0.25 * 100 / (300 * kL);
  EXPECT_NEAR(speed(threshold + left) / v, 1, 0.06);
}

TEST(GrindingLaws, HalfSlotsUpAndDownTakeEnergyInTheRatioOfTheFactor) {
  // Over the half front the mean of c is half of its end: u (1 ± g/2). The axis goes along a face
  // of the block, with what is ground on the left of the feed (down-cutting) or on its right.
  GrindingProperties t{300, 0.25};
  t.up_cutting = 0.4;
  const auto u_at = [&](double x) {
    const Outcome r = run(block(0.1, 6, Vec3(4, 6, 6)), paper_cylinder(), with(t), Drive::kDirect,
                          straight_path({Vec3(x, -1.5, -1.5), Vec3(x, -2.3, -1.5)}, 0.5));
    return r.totals.cutting_work[0] / r.totals.swept[0] / t.specific_energy;
  };
  EXPECT_NEAR(u_at(2), 0.8, 0.01);
  EXPECT_NEAR(u_at(-2), 1.2, 0.01);
}

TEST(GrindingLaws, TheCouplingsLagIsTheForceOfTheFeedOverK) {
  for (const Law& law : laws()) {
    Parameters p = with(law.tissue);
    p.coupling.stiffness = 8;  // settles within a second
    const double v = 0.4;
    const reference::SteadyLoad exact = in_slot(law.tissue, 100, v);
    const Outcome r = run(block(0.1, 6, Vec3(6, 6, 6)), paper_cylinder(), p, Drive::kCoupled,
                          straight_path({Vec3(0, -1, -1.5), Vec3(0, -4, -1.5)}, v));
    const Plateau at = plateau(r.rows, 0.1);
    const StepRecord& last = r.rows.back();
    // Across, a free bur goes aside until the spring holds it: both components balance.
    const Vec3 lag = last.handle.pose.position - last.bur.position;
    EXPECT_NEAR(
        (last.grinding_force + p.coupling.stiffness * lag).norm() / last.grinding_force.norm(), 0,
        0.01)
        << law.name;
    EXPECT_NEAR(at.force.y() / exact.against, 1, 0.02) << law.name;
  }
}

TEST(GrindingLaws, BackwardEulerStaysStableWhateverTheTimeStep) {
  for (const Law& law : laws())
    for (const double h : {5e-4, 1e-2, 0.05}) {
      Parameters p = with(law.tissue);
      p.time_step = h;
      p.coupling.stiffness = 5;
      const Outcome r = run(block(0.1, 8, Vec3(6, 8, 6)), paper_cylinder(), p, Drive::kCoupled,
                            straight_path({Vec3(0, -1, -1.5), Vec3(0, -2, -1.5)}, 0.5, {}, h));
      // On the way to the plateau the force only rises.
      double most = 0, back = 0;
      for (const StepRecord& row : r.rows) {
        most = std::max(most, row.grinding_force.y());
        back = std::max(back, most - row.grinding_force.y());
      }
      EXPECT_LT(most, 1.05 * in_slot(law.tissue, 100, 0.5).against) << law.name << " " << h;
      EXPECT_LT(back, 0.05 * most) << law.name << " " << h;
      EXPECT_EQ(r.totals.unsettled_steps, 0) << law.name << " " << h;
    }
}

Handpiece drooping(double k) {
  Handpiece h = preset_parameters("physical").handpiece;
  h.rotation_rate = 100, h.stall_torque = 2, h.droop_exponent = k;
  return h;
}

Spindle turning(double k) { return Spindle(drooping(k), true, 0, 1e-3); }

TEST(GrindingLaws, AnImposedFeedTurnsAtTheLargestRateThatGivesItsTorque) {
  // unit torque C N^m: T = C N^(m-1), and at m = 1/2 with linear droop sqrt(x) (1 - x) = c has the
  // root of a cubic in sqrt(x); c is at most 2/(3 sqrt(3)), at x = 1/3.
  for (const double c : {0.01, 0.2, 0.38, 0.3848}) {
    Trial trial;
    const auto unit = [&](double rate) { return c * 2 * 10 * std::sqrt(rate); };
    turn_at_imposed_feed_of(turning(1), unit, trial);
    const double y = 2 / std::sqrt(3) * std::cos(std::acos(-1.5 * std::sqrt(3) * c) / 3);
    ASSERT_TRUE(trial.operating_point) << c;
    EXPECT_NEAR(trial.rotation_rate, 100 * y * y, 2e-6) << c;
  }
  Trial trial;
  turn_at_imposed_feed_of(
      turning(1), [](double rate) { return 0.3851 * 20 * std::sqrt(rate); }, trial);
  EXPECT_FALSE(trial.operating_point);
}

TEST(GrindingLaws, ALinearUnitTorqueTurnsAsTheClosedFormSays) {
  for (const double k : {1.0, 2.0})
    for (const double unit : {0.0, 1.0, 20.0, 45.0, 49.9, 51.0, 90.0}) {
      Trial a, b;
      turn_at_imposed_feed(turning(k), unit, a);
      turn_at_imposed_feed_of(
          turning(k), [&](double) { return unit; }, b);
      ASSERT_EQ(a.operating_point, b.operating_point) << unit;
      if (a.operating_point) {
        EXPECT_NEAR(a.rotation_rate, b.rotation_rate, 1e-6) << unit;
      }
    }
}

TEST(GrindingLaws, WithDroopTorqueAndRateLieOnItsLine) {
  for (const Drive drive : {Drive::kDirect, Drive::kCoupled})
    for (const Law& law : laws()) {
      Parameters p = with(law.tissue);
      p.handpiece = drooping(1);
      p.handpiece.stall_torque = 5;
      const Outcome r = slot(p, drive, 0.3, 0.6);
      const StepRecord& row = r.rows.back();
      ASSERT_FALSE(row.stalled) << law.name;
      EXPECT_GT(row.torque, 0.05);
      EXPECT_NEAR(row.torque, 5 * (1 - row.rotation_rate / 100), 2e-5) << law.name;
      EXPECT_EQ(r.totals.unsettled_steps, 0) << law.name;
      if (drive == Drive::kDirect) {  // a coupled bur has moved by a voxel
        EXPECT_NEAR(r.energy_ratio(p), 1, 0.02) << law.name;
      }
    }
}

TEST(GrindingLaws, EachTissueHasItsOwn) {
  GrindingProperties a{300, 0.25}, b{100, 0.5};
  a.size_exponent = 0.4, a.reference_chip = 5e-3;
  b.rubbing_pressure = 0.2, b.reference_chip = 1e-3;
  Parameters p = with(b);
  p.tissue[0] = a;
  // Two thirds of the bur's length in enamel (the block's top), one in dentin.
  const LayeredTooth tooth = block(0.1, 2.5, Vec3(4, 6, 6));
  const Pose up{Vec3::Zero(), Quat(Eigen::AngleAxisd(-kPi / 2, Vec3::UnitX()))};
  std::vector<HandleSample> path = straight_path({Vec3(-1, -3.5, 0), Vec3(0, -3.5, 0)}, 0.5);
  for (HandleSample& s : path) s.pose.orientation = up.orientation;
  const Outcome r = run(tooth, paper_cylinder(), p, Drive::kDirect, path);
  const StepRecord& last = r.rows.back();
  ASSERT_GT(last.contact_area[0], 0);
  ASSERT_GT(last.contact_area[1], 0);
  const double of = 1 / (last.contact_area[0] + last.contact_area[1]);
  const double exact = last.contact_area[0] * of * in_slot(a, 100, 0.5).torque +
                       last.contact_area[1] * of * in_slot(b, 100, 0.5).torque;
  EXPECT_NEAR(plateau(r.rows, 0.3).torque / exact, 1, 0.01);
  EXPECT_NEAR(r.energy_ratio(p), 1, 0.02);
}

}  // namespace
}  // namespace toothprep::testing::laws
