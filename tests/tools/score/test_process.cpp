#include <gtest/gtest.h>

#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/score/definitions.h"
#include "toothprep/tools/score/process.h"

namespace toothprep {
namespace {

// A recording row by row: each step takes 0.1 s unless said otherwise, and the bur moves along x.
class MadeRecording {
 public:
  MadeRecording() { rows_.push_back(StepRecord{}); }
  StepRecord& step(double move = 0, double h = 0.1) {
    StepRecord row;
    row.handle.time = rows_.back().handle.time + h;
    row.bur.position = rows_.back().bur.position + Vec3(move, 0, 0);
    row.handle.pose = row.bur;
    row.removed_volume = rows_.back().removed_volume;
    rows_.push_back(row);
    return rows_.back();
  }
  // In enamel, with a grinding force along y.
  StepRecord& cut(double move = 0, double force = 1, double h = 0.1) {
    StepRecord& row = step(move, h);
    row.contact_area[0] = 0.5;
    row.grinding_force = Vec3(0, force, 0);
    return row;
  }
  const std::vector<StepRecord>& rows() const { return rows_; }
  ProcessFigures figures(const ProcessOptions& options = {}) const {
    return process_figures(rows_, options);
  }
  double figure(const std::string& key, const ProcessOptions& options = {}) const {
    const ProcessFigures all = figures(options);
    const Quantity* q = find_quantity(all.quantities, "process." + key);
    return q ? q->value : NAN;
  }

 private:
  std::vector<StepRecord> rows_;
};

TEST(Process, TimePathAndSpeed) {
  MadeRecording r;
  r.step(1.0);
  r.step(-0.5, 0.4);  // back, slower: the path adds lengths
  r.cut(0.25, 1, 0.5);
  EXPECT_NEAR(r.figure("time_s"), 1.0, 1e-12);
  EXPECT_NEAR(r.figure("path_mm"), 1.75, 1e-12);
  EXPECT_NEAR(r.figure("path_cutting_mm"), 0.25, 1e-12);
  EXPECT_NEAR(r.figure("mean_speed_mm_s"), 1.75, 1e-12);
  EXPECT_NEAR(r.figure("mean_feed_mm_s"), 0.5, 1e-12);
}

// Two burs, two recordings: sums add up, and the way from one's end to the other's start isn't one.
TEST(Process, RecordingsOneAfterAnotherAddUp) {
  MadeRecording first, second;
  first.cut(1.0, 3);
  first.step(2.0).removed_volume[0] = 0.5;
  second.step(100);  // elsewhere
  second.cut(0.5, 2);
  second.step().removed_volume[0] = 0.25;
  std::vector<StepRecord> rows;
  append_recording(rows, first.rows());
  const std::size_t start = append_recording(rows, second.rows());
  EXPECT_EQ(start, first.rows().size());
  EXPECT_NEAR(rows.back().removed_volume[0], 0.75, 1e-12);
  const ProcessFigures both = process_figures(rows, {}, {start});
  for (const char* key :
       {"time_s", "path_mm", "cutting_time_s", "path_cutting_mm", "contact_time_s"})
    EXPECT_NEAR(find_quantity(both.quantities, std::string("process.") + key)->value,
                first.figure(key) + second.figure(key), 1e-12)
        << key;
  EXPECT_THROW(static_cast<void>(process_figures(rows, {})), Error) << "its time stands still";
}

TEST(Process, ContactIsAreaOrRemovalAndAStallIsContactWithoutCutting) {
  MadeRecording r;
  r.step();
  r.cut();                           // contact by area
  r.step().removed_volume[1] = 0.1;  // contact by removal that was due after the bur had left
  r.cut().stalled = true;            // contact, no cutting
  r.step();                          // the removed volume stays where it was: no contact
  EXPECT_NEAR(r.figure("contact_time_s"), 0.3, 1e-12);
  EXPECT_NEAR(r.figure("cutting_time_s"), 0.2, 1e-12);
  EXPECT_NEAR(r.figure("stalled_time_s"), 0.1, 1e-12);
}

TEST(Process, RemovalRateIsVolumeOverCuttingTime) {
  MadeRecording r;
  r.cut().removed_volume[0] = 0.3;
  r.cut().removed_volume = {0.4, 0.2, 0, 0};
  r.step(0, 5.0);  // rest
  EXPECT_NEAR(r.figure("removal_rate_mm3_s"), 0.6 / 0.2, 1e-9);
}

TEST(Process, ForcesAreThoseInContactWeightedByTime) {
  MadeRecording r;
  r.step().grinding_force = Vec3(9, 0, 0);  // without contact: not counted
  for (int i = 0; i < 94; ++i) r.cut(0, 1, 0.01);
  r.cut(0, 2, 0.01);
  r.cut(0, 3, 0.04);
  r.cut(0, 5, 0.01).device_force = Vec3(3, 4, 0);
  EXPECT_NEAR(r.figure("peak_force_n"), 5, 1e-12);
  // Of 1 s in contact: 0.94 s at 1 N, 0.01 s at 2 N: 2 N is not exceeded in 95 % of it.
  EXPECT_NEAR(r.figure("force_p95_n"), 2, 1e-12);
  EXPECT_NEAR(r.figure("peak_device_force_n"), 5, 1e-12);
  EXPECT_NEAR(r.figure("device_force_p95_n"), 0, 1e-12);
}

TEST(Process, TimeAboveTheForceLimitCountsWhatIsAboveNotAt) {
  MadeRecording r;
  r.cut(0, 2.0);
  r.cut(0, 2.1);
  r.cut(0, 3.0);
  EXPECT_NEAR(r.figure("time_above_force_limit_s"), 0.2, 1e-12);
  ProcessOptions options;
  options.force_limit = 2.5;
  EXPECT_NEAR(r.figure("time_above_force_limit_s", options), 0.1, 1e-12);
}

TEST(Process, PowerIsToldInWattAndEnergyInJoule) {
  MadeRecording r;
  r.cut().power = 500;  // N·mm/s = mW
  r.cut().power = 1500;
  r.step(0, 1.0);
  EXPECT_NEAR(r.figure("peak_power_w"), 1.5, 1e-12);
  EXPECT_NEAR(r.figure("energy_j"), 0.2, 1e-12);      // 0.5 W * 0.1 s + 1.5 W * 0.1 s
  EXPECT_NEAR(r.figure("mean_power_w"), 1.0, 1e-12);  // over the 0.2 s of cutting
  EXPECT_NEAR(r.figure("time_above_power_limit_s"), 0.1, 1e-12);
}

TEST(Process, StallsAreCountedByTheirBeginnings) {
  MadeRecording r;
  r.cut();
  for (const bool stalled : {true, true, false, true, false}) r.cut().stalled = stalled;
  EXPECT_EQ(r.figure("stalls"), 2);
  EXPECT_NEAR(r.figure("stalled_time_s"), 0.3, 1e-12);
}

TEST(Process, ForbiddenTissueIsPulpAndTheNeighbour) {
  MadeRecording r;
  r.step().contact_area[2] = 0.1;
  r.step().removed_volume[3] = 0.01;
  r.step().contact_area[3] = 0.2;
  EXPECT_NEAR(r.figure("pulp_contact_s"), 0.1, 1e-12);
  EXPECT_NEAR(r.figure("neighbour_contact_s"), 0.2, 1e-12);
}

TEST(Process, LagIsTheLargestDistanceOfHandleAndBur) {
  MadeRecording r;
  r.step().handle.pose.position += Vec3(0.3, 0.4, 0);
  r.step().handle.pose.position += Vec3(0.1, 0, 0);
  EXPECT_NEAR(r.figure("max_lag_mm"), 0.5, 1e-12);
}

TEST(Process, ShortInterruptionsDontEndAnEpisode) {
  MadeRecording r;
  r.cut(0, 1, 0.05);
  r.step(0, 0.05);  // shorter than 0.1 s
  r.cut(0, 1, 0.05);
  r.step(0, 0.2);
  r.cut(0, 1, 0.05);
  EXPECT_EQ(r.figure("contact_episodes"), 2);
  EXPECT_NEAR(r.figure("contact_time_s"), 0.15, 1e-12);  // time is counted without the gaps
}

TEST(Process, EventsComeInTimeWithTheirSpans) {
  MadeRecording r;
  r.step(0, 1.0);
  r.cut(0, 1, 1.0);
  r.cut(0, 3, 1.0);  // above the limit
  StepRecord& stall = r.cut(0, 1, 1.0);
  stall.stalled = true;
  stall.contact_area[2] = 0.1;
  r.step(0, 1.0).contact_area[3] = 0.1;
  const std::vector<ProcessEvent> events = r.figures().events;
  ASSERT_EQ(events.size(), 5u);
  const ProcessEvent expected[] = {{1, 5, ProcessEventKind::kContact},
                                   {2, 3, ProcessEventKind::kForceLimit},
                                   {3, 4, ProcessEventKind::kStall},
                                   {3, 4, ProcessEventKind::kPulp},
                                   {4, 5, ProcessEventKind::kNeighbour}};
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(events[i].kind, expected[i].kind) << i;
    EXPECT_NEAR(events[i].begin, expected[i].begin, 1e-12) << i;
    EXPECT_NEAR(events[i].end, expected[i].end, 1e-12) << i;
  }
}

TEST(Process, ABurThatTouchedNothingHasNoForcesAndNoRates) {
  MadeRecording r;
  r.step(1);
  for (const char* key : {"mean_feed_mm_s", "peak_force_n", "force_p95_n", "removal_rate_mm3_s",
                          "mean_power_w", "peak_device_force_n"})
    EXPECT_TRUE(std::isnan(r.figure(key))) << key;
  EXPECT_EQ(r.figure("contact_episodes"), 0);
}

TEST(Process, ContactWithBodiesIsCountedByTheirAreas) {
  MadeRecording r;
  r.cut(0, 1, 0.1).other_bodies[0] = {2, 0.25};                   // the neighbour
  r.cut(0, 1, 0.2).other_bodies = {{{3, 0.25}, {2, 0.125}, {}}};  // gum and the neighbour
  r.cut(0, 1, 0.4).contact_area[3] = 0.5;  // `other`, but of the tooth itself
  const Quantities quantities =
      process_figures(
          r.rows(), {}, {},
          {{"36", BodyKind::kTooth}, {"37", BodyKind::kNeighbour}, {"gum", BodyKind::kGum}})
          .quantities;
  const auto figure = [&](const char* key) { return find_quantity(quantities, key)->value; };
  EXPECT_NEAR(figure("process.neighbour_contact_s"), 0.3, 1e-12);
  EXPECT_NEAR(figure("process.body_contact_s.37"), 0.3, 1e-12);
  EXPECT_NEAR(figure("process.body_contact_s.gum"), 0.2, 1e-12);
  EXPECT_NEAR(figure("process.gum_contact_s"), 0.2, 1e-12);
}

TEST(Process, EveryFigureIsInTheTableWithItsUnit) {
  MadeRecording r;
  r.cut().removed_volume[0] = 0.1;
  // One body of each kind that isn't to be touched, so that every row of the table is there.
  const Quantities quantities =
      process_figures(
          r.rows(), {}, {},
          {{"36", BodyKind::kTooth}, {"37", BodyKind::kNeighbour}, {"gum", BodyKind::kGum}})
          .quantities;
  std::size_t defined = 0;
  for (const std::string& key : known_quantity_keys()) defined += key.rfind("process.", 0) == 0;
  EXPECT_EQ(quantities.size(), defined + 1);  // body_contact_s is there twice
  for (const Quantity& q : quantities) {
    ASSERT_NE(find_definition(q.key), nullptr) << q.key;
    EXPECT_EQ(q.unit, find_definition(q.key)->unit) << q.key;
    EXPECT_TRUE(std::isfinite(q.value)) << q.key;
  }
}

TEST(Process, RecordingsWithoutStepsAndLimitsWithoutSenseAreRefused) {
  EXPECT_THROW(static_cast<void>(process_figures({}, {})), Error);
  MadeRecording r;
  EXPECT_THROW(r.figures(), Error);
  r.step(0, 0.0);
  EXPECT_THROW(r.figures(), Error);  // time stands still
  MadeRecording good;
  good.step();
  ProcessOptions options;
  options.force_limit = NAN;
  EXPECT_THROW(good.figures(options), Error);
}

}  // namespace
}  // namespace toothprep
