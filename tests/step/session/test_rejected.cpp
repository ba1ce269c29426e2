// Readings that are rejected: no step is made.
#include <gtest/gtest.h>

#include "experiment.h"
#include "toothprep/step/core/units.h"

namespace toothprep::testing {
namespace {

// Into the block's side and on, with a reading 3 mm deeper in the middle of the cut.
std::vector<HandleSample> path_with_glitch(bool rejected) {
  const Quat upright(Eigen::AngleAxisd(-units::kPi / 2, Vec3::UnitX()));
  auto path = straight_path({Vec3(-5, -0.5, 0), Vec3(-2, -0.5, 0)}, 2.0);
  for (HandleSample& s : path) s.pose.orientation = upright;
  HandleSample& glitch = path[1200];
  glitch.pose.position += Vec3(0, -3, 0);
  glitch.rejected = rejected;
  return path;
}

class RejectedReadings : public ::testing::TestWithParam<Drive> {};

TEST_P(RejectedReadings, CutNothingAndAreNotFelt) {
  const Parameters p = paper_without_stall();
  const Bur bur = make_bur("cylinder:D1.2xL3.0", "");
  const LayeredTooth tooth = block(0.1, 2);
  const auto glitch = path_with_glitch(true);
  auto clean = glitch;
  clean.erase(clean.begin() + 1200);
  Workpiece with(tooth), without(tooth);
  Session a(bur, with, p, GetParam(), glitch[0]), b(bur, without, p, GetParam(), clean[0]);
  StepRecord row, expected;
  for (std::size_t i = 1; i < glitch.size(); ++i) {
    const StepRecord before = row;
    row = a.step(glitch[i]);
    if (i != 1200) {
      expected = b.step(clean[i < 1200 ? i : i - 1]);
      EXPECT_LT((row.bur.position - expected.bur.position).norm(), 5e-3) << i;
      continue;
    }
    EXPECT_GT(before.grinding_force.norm(), 0.1) << "it has to be in the cut";
    EXPECT_EQ(row.handle.pose.position, glitch[1200].pose.position);
    EXPECT_EQ(row.bur.position, before.bur.position);
    EXPECT_EQ(row.bur_velocity, Vec3(Vec3::Zero()));
    EXPECT_EQ(row.device_force, Vec3(Vec3::Zero()));
    EXPECT_EQ(row.grinding_force, Vec3(Vec3::Zero()));
    EXPECT_EQ(row.power, 0);
    EXPECT_EQ(row.removed_volume, before.removed_volume);
  }
  a.finish(row);
  b.finish(expected);
  EXPECT_NEAR(row.removed_volume[0], expected.removed_volume[0], 1e-3 * expected.removed_volume[0]);
  EXPECT_EQ(a.totals().rejected_steps, 1);
}

TEST(RejectedReadingsTaken, WouldHaveDrilled) {
  const Parameters p = paper_without_stall();
  const Bur bur = make_bur("cylinder:D1.2xL3.0", "");
  const LayeredTooth tooth = block(0.1, 2);
  Workpiece workpiece(tooth);
  const auto path = path_with_glitch(false);
  Session session(bur, workpiece, p, Drive::kDirect, path[0]);
  for (std::size_t i = 1; i < 1200; ++i) session.step(path[i]);
  const double before = session.totals().removed[0];
  StepRecord row = session.step(path[1200]);
  for (int i = 0; i < 9; ++i) row = session.step(path[1201]);
  session.finish(row);
  EXPECT_GT(session.totals().removed[0], before + 0.04);
}

INSTANTIATE_TEST_SUITE_P(Drives, RejectedReadings,
                         ::testing::Values(Drive::kDirect, Drive::kCoupled), [](const auto& drive) {
                           return drive.param == Drive::kDirect ? "Direct" : "Coupled";
                         });

}  // namespace
}  // namespace toothprep::testing
