// A session that is paused, taken back, and goes on with another bur and another frame; and its replay.
#include <gtest/gtest.h>

#include "controlled_session.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/live/session_control.h"

namespace toothprep::testing {
namespace {

void expect_same(const std::vector<LiveTick>& live, const std::vector<StepRecord>& replayed) {
  ASSERT_EQ(live.size(), replayed.size());
  for (std::size_t i = 0; i < live.size(); ++i) {
    const StepRecord &a = live[i].row, &b = replayed[i];
    ASSERT_EQ(a.bur.position, b.bur.position) << i;
    ASSERT_EQ(a.bur.orientation.coeffs(), b.bur.orientation.coeffs()) << i;
    ASSERT_EQ(a.device_force, b.device_force) << i;
    ASSERT_EQ(a.torque, b.torque) << i;
    ASSERT_EQ(a.removed_volume, b.removed_volume) << i;
  }
}

TEST(Pause, ReplaysToTheLastBitWithUndoAnotherBurAndAnotherFrame) {
  Controlled c;
  c.run(2999);
  const double cut = c.rows.ticks.back().row.removed_volume[0];
  ASSERT_GT(cut, 0.1);
  c.pause();
  c.run(1100);
  c.undo();
  c.change_bur();
  LiveCommand move;
  move.shift = Vec3(0, 0.25, 0.5);
  c.post(EventKind::kRegistration, move);
  c.resume();
  const StepRecord& paused = c.rows.ticks.back().row;
  EXPECT_EQ(paused.removed_volume[0], 0);
  c.run(3300);
  c.finish();
  EXPECT_GT(c.rows.ticks.back().row.removed_volume[0], 0.1);
  const std::vector<StepRecord> replayed = c.replayed();
  expect_same(c.rows.ticks, replayed);
  EXPECT_EQ(c.totals.removed[0], replayed.back().removed_volume[0]);
  EXPECT_GT(c.ground[0], c.totals.removed[0] + 0.9 * cut);
  EXPECT_EQ(c.totals.torque_work, c.intervals.totals().torque_work);
}

TEST(Pause, RampsTheForceOutAndMakesNoSteps) {
  Controlled c;
  c.run(2900);
  ASSERT_GT(c.rows.ticks.back().commanded_force.norm(), 0.2);
  c.pause();
  c.run(300);
  const auto& ticks = c.rows.ticks;
  std::size_t i = 0;
  while (ticks[i].event.kind != EventKind::kPause) ++i;
  EXPECT_NEAR(static_cast<double>(i), 2900 + 50, 3);  // fade: 0.05 s
  for (std::size_t k = 2900; k < i; ++k)
    EXPECT_LT((ticks[k + 1].commanded_force - ticks[k].commanded_force).norm(), 0.1);
  for (std::size_t k = i; k < ticks.size(); ++k) {
    ASSERT_EQ(ticks[k].commanded_force, Vec3::Zero());
    ASSERT_EQ(ticks[k].row.bur.position, ticks[i].row.bur.position);
    ASSERT_EQ(ticks[k].row.removed_volume, ticks[i].row.removed_volume);
    ASSERT_EQ((ticks[k].flags & kPaused) != 0, k > i);
    ASSERT_EQ(ticks[k].row.handle.rejected, k > i);
  }
}

TEST(Pause, ResumesWhereTheHandIsAndWaitsForASafeStart) {
  Controlled c;
  c.run(2900);
  c.pause();
  c.run(1200);
  c.resume();
  c.run(1500);
  const auto& ticks = c.rows.ticks;
  std::size_t i = 0;
  while (ticks[i].event.kind != EventKind::kResume) ++i;
  EXPECT_EQ(ticks[i].row.bur.position, ticks[i].row.handle.pose.position);
  EXPECT_FALSE(ticks[i].row.handle.rejected);
  std::size_t turns = i + 1;
  while (!(ticks[turns].row.handle.buttons & kPedalButton)) ++turns;
  EXPECT_NEAR(static_cast<double>(turns - i), 1000 * kClearBefore, 3);
  EXPECT_TRUE(ticks[i + 10].flags & kMotorLocked);
}

TEST(Pause, EveryUndoGoesBackAnIntervalAndTheToothWithIt) {
  Controlled c;
  c.run(2700);
  c.pause();
  const PerTissue<double> first = c.intervals.removed_before();
  EXPECT_GT(first[0], 0);
  c.run(1400);
  c.resume();
  c.run(3000);
  c.pause();
  EXPECT_GT(c.intervals.removed_before()[0], first[0]);
  ASSERT_TRUE(c.intervals.undo());
  EXPECT_EQ(c.intervals.removed_before(), first);
  ASSERT_TRUE(c.intervals.undo());
  EXPECT_EQ(c.intervals.removed_before()[0], 0);
  EXPECT_FALSE(c.intervals.undo());
}

TEST(Pause, EventsThatDontFitARecordingAreRefusedWithTheirTime) {
  const LayeredTooth tooth = enamel_block();
  const auto refusal = [&](std::vector<SessionEvent> events) -> std::string {
    Workpiece workpiece(tooth);
    Interventions all{std::move(events), {paper_cylinder()}, "session.h5"};
    try {
      replay(paper_cylinder(), workpiece, preset_parameters("paper"), Drive::kCoupled,
             slot(1, 0.05), {}, all);
    } catch (const InputError& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_NE(refusal({{0.02, EventKind::kUndo, {}}}).find("undo at 0.02"), std::string::npos);
  EXPECT_NE(refusal({{0.0201, EventKind::kPause, {}}}).find("no sample of that time"),
            std::string::npos);
  EXPECT_NE(
      refusal({{0.02, EventKind::kPause, {}}, {0.03, EventKind::kBur, {7}}}).find("no such bur"),
      std::string::npos);
  EXPECT_EQ(refusal({{0.02, EventKind::kPause, {}}, {0.03, EventKind::kResume, {}}}), "");
}

TEST(SessionControl, HoldsBackWhatIsTooMuchAndHandsTheRestOnInOrder) {
  SessionControl control;
  int taken = 0;
  for (int i = 0; i < 100; ++i) taken += control.ask({EventKind::kBur, i, {}, {}});
  EXPECT_EQ(taken, 32);
  for (int i = 0; i < taken; ++i) EXPECT_EQ(control.next()->bur, i);
  EXPECT_FALSE(control.next());
}

}  // namespace
}  // namespace toothprep::testing
