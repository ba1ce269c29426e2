// Steps that go in parts since the bur is fast: their rows, what they count, and what they cost.
#include <gtest/gtest.h>

#include <algorithm>

#include "experiment.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/session/split_step.h"

namespace toothprep::testing {
namespace {

constexpr double kStep = 1e-3;

StepRecord part(double x, double force, double torque, double rate) {
  StepRecord r;
  r.bur.position = Vec3(x, 0, 0);
  r.bur_velocity = Vec3(1000 * x, 0, 0);
  r.grinding_force = Vec3(0, force, 0);
  r.device_force = Vec3(0, 0, x);
  r.torque = r.torque_trial = torque;
  r.rotation_rate = rate;
  r.power = 2 * units::kPi * rate * torque;
  r.contact_area[0] = force;
  return r;
}
StepRecord stalled_part(double x, double torque, double trial_torque) {
  StepRecord r = part(x, 7, torque, 0);
  r.bur_velocity.setZero();
  r.torque_trial = trial_torque;
  r.stalled = true;
  r.stalled_fraction = 1;
  return r;
}

TEST(SplitStep, TheRowOfOnePartIsThatPart) {
  const StepRecord only = part(0.3, 2, 0.5, 100);
  SplitStepRow whole;
  whole.add(only);
  const StepRecord row = whole.row(Vec3(9, 9, 9), kStep);
  EXPECT_EQ(row.bur_velocity, only.bur_velocity);
  EXPECT_EQ(row.grinding_force, only.grinding_force);
  EXPECT_EQ(row.torque, only.torque);
  EXPECT_EQ(row.power, only.power);
  EXPECT_EQ(row.rotation_rate, only.rotation_rate);
  EXPECT_EQ(row.stalled_fraction, 0);
}

TEST(SplitStep, PoseAndDeviceForceAreThoseOfTheEndAndTheRestMeansOverTime) {
  SplitStepRow whole;
  whole.add(part(0.1, 1, 0.2, 100));
  whole.add(part(0.4, 3, 0.6, 80));
  const StepRecord row = whole.row(Vec3(-0.1, 0, 0), kStep);
  EXPECT_EQ(row.bur.position.x(), 0.4);
  EXPECT_EQ(row.device_force.z(), 0.4);
  EXPECT_DOUBLE_EQ(row.bur_velocity.x(), 0.5 / kStep);
  EXPECT_DOUBLE_EQ(row.grinding_force.y(), 2);
  EXPECT_DOUBLE_EQ(row.contact_area[0], 2);
  EXPECT_DOUBLE_EQ(row.torque, 0.4);
  // The energy of the row is that of its parts, and the rate follows from it.
  EXPECT_DOUBLE_EQ(row.power, 2 * units::kPi * (100 * 0.2 + 80 * 0.6) / 2);
  EXPECT_DOUBLE_EQ(row.rotation_rate, (100 * 0.2 + 80 * 0.6) / (0.2 + 0.6));
}

TEST(SplitStep, AStallInAnEarlierPartIsInTheRow) {
  SplitStepRow whole;
  whole.add(part(0.1, 1, 0.8, 100));
  whole.add(stalled_part(0.1, 1.2, 1.5));
  whole.add(stalled_part(0.1, 1.2, 1.3));
  whole.add(part(0.2, 1, 0.8, 100));
  const StepRecord row = whole.row(Vec3::Zero(), kStep);
  EXPECT_TRUE(row.stalled);
  EXPECT_EQ(row.stalled_fraction, 0.5);
  EXPECT_EQ(row.torque_trial, 1.5);
  EXPECT_DOUBLE_EQ(row.torque, 1.0);
  EXPECT_DOUBLE_EQ(row.power, 2 * units::kPi * 100 * 0.8 / 2);
}

TEST(SplitStep, StalledThroughoutItIsARowOfAStalledStep) {
  SplitStepRow whole;
  for (int i = 0; i < 7; ++i) whole.add(stalled_part(0.1, 1.2, 1.3));
  const StepRecord row = whole.row(Vec3(0.1, 0, 0), kStep);
  EXPECT_EQ(row.stalled_fraction, 1);
  EXPECT_EQ(row.torque, 1.2);  // to the bit
  EXPECT_EQ(row.bur_velocity, Vec3(Vec3::Zero()));
  EXPECT_EQ(row.power, 0);
  EXPECT_EQ(row.rotation_rate, 0);
}

TEST(SplitStep, WithoutTorqueTheRotationRateIsThatOfTheLastPart) {
  SplitStepRow whole;
  whole.add(part(0.1, 0, 0, 90));
  whole.add(part(0.2, 0, 0, 100));
  EXPECT_EQ(whole.row(Vec3::Zero(), kStep).rotation_rate, 100);
}

TEST(SplitStep, PartsAreAboutAThirdOfAVoxelAndBounded) {
  EXPECT_EQ(wanted_parts(0.49), 1);
  EXPECT_EQ(wanted_parts(0.66), 2);
  EXPECT_EQ(wanted_parts(3.3), 10);
  EXPECT_EQ(wanted_parts(1e9), 64);
  EXPECT_EQ(wanted_parts(std::nan("")), 1);
  // Half a millisecond at 100 ns an element: 10 parts of 500 elements; never fewer than two.
  EXPECT_EQ(most_parts(500, 1e-3), 10);
  EXPECT_EQ(most_parts(1000000, 1e-3), 2);
  EXPECT_EQ(most_parts(1, 1e-3), 64);
}

// A bur that comes out of a spring stretched by `stretch` mm and meets the block again: the handle
// pulls it off a corner and across to the other wall of a slot.
Outcome swing(const Parameters& p) {
  return run(block(0.1, 6, Vec3(5, 6, 5)), paper_cylinder(), p, Drive::kCoupled,
             straight_path({Vec3(-0.1, 0.8, -1.5), Vec3(5.4, -4.7, -1.5)}, 0.5));
}

TEST(SplitStep, EveryRowOfAFastBurKeepsPowerTorqueRateAndWay) {
  const Parameters p = paper_without_stall();
  const Outcome r = swing(p);
  ASSERT_GT(r.totals.split_steps, 3);
  double work = 0;
  for (std::size_t i = 1; i < r.rows.size(); ++i) {
    const StepRecord& row = r.rows[i];
    work += row.power * kStep;
    EXPECT_NEAR(row.power, 2 * units::kPi * row.rotation_rate * row.torque,
                1e-12 * (1 + row.power));
    const Vec3 way = row.bur.position - r.rows[i - 1].bur.position;
    EXPECT_LT((row.bur_velocity - way / kStep).norm(), 1e-9 * (1 + row.bur_velocity.norm()));
  }
  EXPECT_NEAR(work, r.totals.torque_work, 1e-12 * work);
}

TEST(SplitStep, AStallWithinAFastStepIsCounted) {
  Parameters p = paper_without_stall();
  // How hard the bur meets the wall depends on where exactly it came off the corner. A run without
  // the limit, the same up to the stall, has it.
  double cut = 0, peak = 0;
  for (const StepRecord& row : swing(p).rows) {
    if (peak == 0 && row.bur_velocity.norm() < 100)
      cut = std::max(cut, row.torque_trial);
    else
      peak = std::max(peak, row.torque_trial);
  }
  ASSERT_GT(peak, 2 * cut) << "the swing ends at the wall, harder than the cut it came from";
  p.handpiece.stall_torque = (cut + peak) / 2;
  const Outcome r = swing(p);
  long stalled = 0, partly = 0;
  for (const StepRecord& row : r.rows) {
    stalled += row.stalled;
    partly += row.stalled_fraction > 0 && row.stalled_fraction < 1;
    EXPECT_EQ(row.stalled, row.stalled_fraction > 0);
  }
  EXPECT_EQ(stalled, r.totals.stalled_steps);
  EXPECT_GE(r.totals.stall_onsets, 1);
  EXPECT_GE(partly, 1) << "the bur met the wall within a step, not at its end";
}

TEST(SmallElements, TheSizeThatWouldDoFillsHalfOfTheStep) {
  // 620 elements at 100 ns take 62 µs of 500; 20000 take four times as long as there is.
  EXPECT_LT(least_live_size(0.075, 620, 1e-3), 0.075);
  EXPECT_NEAR(least_live_size(0.01, 20000, 1e-3), 0.02, 1e-12);
}

}  // namespace
}  // namespace toothprep::testing
