// What a run says of its outcome.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "experiment.h"
#include "toothprep/step/session/run_warnings.h"

namespace toothprep::testing {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// The block's top is y = 0, its sides x, z = -4 and 4; a ball of 1.2 mm has its tip at the pose.
StepRecord row_at(double time, const Vec3& tip, std::uint32_t buttons = kPedalButton) {
  StepRecord row;
  row.handle.time = time;
  row.handle.buttons = buttons;
  row.bur.position = tip;
  return row;
}

class RunWarnings : public ::testing::Test {
 protected:
  const Bur ball_ = make_bur("ball:D1.2", "");
  const LayeredTooth tooth_ = block(0.1, 2);
};

TEST_F(RunWarnings, LeastDistanceIsThatOfTheHeadsSurface) {
  // Upright: the ball's centre is 0.6 above the tip in z. Beside the block, over its edge, inside.
  for (const auto& [tip, exact] :
       std::vector<std::pair<Vec3, double>>{{{-6, -1, -0.6}, 2 - 0.6},
                                            {{0, 1.5, 0}, 1.5 - 0.6},
                                            {{-7, 4, 0}, 5 - 0.6},
                                            {{-4.5, -1, 0}, 0.5 - 0.6}}) {
    const std::vector<StepRecord> rows = {row_at(0, tip + Vec3(-3, 3, 0)), row_at(0.001, tip)};
    EXPECT_NEAR(least_distance(rows, ball_, tooth_), exact, 0.05) << tip.transpose();
  }
}

TEST_F(RunWarnings, ABurThatNeverReachesTheToothIsReportedWithItsDistance) {
  EXPECT_THAT(
      outcome_warnings({row_at(0, {-7, -1, 0}), row_at(0.001, {-6.9, -1, 0})}, ball_, tooth_),
      ElementsAre(HasSubstr("no nearer to the tooth than 2.3")));
}

TEST_F(RunWarnings, AMotorThatIsNeverOnIsTheReason) {
  EXPECT_THAT(
      outcome_warnings({row_at(0, {-4, -1, 0}, 0), row_at(0.001, {-3.5, -1, 0}, 0)}, ball_, tooth_),
      ElementsAre(HasSubstr("motor was never on")));
}

TEST_F(RunWarnings, PulpAndWhatIsNoToothAreReportedWithTheirTime) {
  std::vector<StepRecord> rows = {row_at(0, {-4, -1, 0}), row_at(0.5, {-3.5, -1, 0}),
                                  row_at(1, {-3, -1, 0})};
  rows[1].removed_volume[static_cast<std::size_t>(tissue_index(Tissue::kPulp))] = 0.01;
  rows[2].removed_volume[static_cast<std::size_t>(tissue_index(Tissue::kPulp))] = 0.25;
  rows[2].removed_volume[static_cast<std::size_t>(tissue_index(Tissue::kOther))] = 0.125;
  EXPECT_THAT(outcome_warnings(rows, ball_, tooth_),
              ElementsAre(HasSubstr("pulp was opened at 0.500 s: 0.250 mm^3"),
                          HasSubstr("from 1.000 s on: 0.125 mm^3")));
}

TEST_F(RunWarnings, ABurThatLeavesTheToothsGridIsReportedWithPlaceAndTime) {
  // The block ends at x = 4; its grid a brick and the margin, at most 1.6 mm, farther.
  std::vector<StepRecord> rows = {row_at(0, {-4, -1, 0}), row_at(0.5, {104, -1, 0}),
                                  row_at(1, {-3, -1, 0}), row_at(1.5, {24, -1, 0})};
  for (std::size_t i = 1; i < rows.size(); ++i) rows[i].removed_volume[0] = 0.1;
  EXPECT_THAT(outcome_warnings(rows, ball_, tooth_),
              ElementsAre(AllOf(HasSubstr("left the tooth's grid"), HasSubstr("at 0.500 s"),
                                HasSubstr("for 25 % of the steps beyond 25 mm"))));
  rows[1].bur.position.x() = 20;
  EXPECT_THAT(outcome_warnings(rows, ball_, tooth_), IsEmpty()) << "a hand that waits beside it";
}

TEST_F(RunWarnings, ACutInEnamelIsNothingToReport) {
  std::vector<StepRecord> rows = {row_at(0, {-4, -1, 0}), row_at(1, {-3, -1, 0})};
  rows[1].removed_volume[0] = 0.1;
  EXPECT_THAT(outcome_warnings(rows, ball_, tooth_), IsEmpty());
}

}  // namespace
}  // namespace toothprep::testing
