#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "experiment.h"
#include "toothprep/step/session/replay.h"
#include "toothprep/tools/calibrate/fit_files.h"
#include "toothprep/tools/calibrate/spindle.h"

namespace toothprep::testing {
namespace {

using ::testing::HasSubstr;

constexpr double kStall = 4.0;  // N·mm

Parameters drooping(double stall_torque) {
  Parameters p = preset_parameters("paper");
  p.tissue = truth();
  p.time_step = 0.002;
  p.handpiece.model = HandpieceModel::kDroop;
  p.handpiece.rotation_rate = 130;
  p.handpiece.stall_torque = stall_torque;
  return p;
}

std::vector<HandleSample> slower(std::vector<HandleSample> path) {
  std::vector<HandleSample> every;
  for (std::size_t i = 0; i < path.size(); i += 2) every.push_back(path[i]);
  return every;
}

// A recording of a handpiece that slows down under load, motion imposed.
struct Droop {
  std::vector<HandleSample> path = slower(mixed_feed());
  MeasuredRecording recording;
  RecordedMotion motion;
  std::vector<ForceBasis> bases;
  long stalled = 0;

  explicit Droop(double stall_torque, const SensorOptions& sensor = {}) {
    const Parameters p = drooping(stall_torque);
    const LayeredTooth tooth = block_with(1.0);
    Workpiece workpiece(tooth);
    ReplayResult run = replay(cylinder(), workpiece, p, Drive::kDirect, path);
    stalled = run.totals.stalled_steps;
    std::vector<Vec3> force;
    for (const StepRecord& row : run.rows) force.push_back(row.grinding_force);
    recording = recorded(path, measured_by(sensor, force, p.time_step));
    disturb_motion_and_speed(sensor, run.rows);
    for (const StepRecord& row : run.rows) {
      recording.rotation_rate.push_back(row.rotation_rate);
      recording.torque.push_back(row.torque);
      recording.stalled.push_back(row.stalled);
    }
    check_recording(recording);
    motion = motion_of(recording, p.time_step, false, true);
    Parameters assumed = preset_parameters("paper");
    assumed.time_step = p.time_step;
    bases = force_bases(cylinder(), tooth, assumed, {motion});
  }
  FitResult fitted(const FitOptions& o = {}) const {
    return fit({compare(recording, bases[0], o.largest_delay, 0, false)}, o);
  }
};

// u itself, not u/N: the basis' own N (100 rev/s) isn't the truth's.
TEST(Spindle, RecordedSpeedTellsUItselfAndTheDroop) {
  const Droop d(kStall);
  ASSERT_EQ(d.stalled, 0);
  FitResult r = d.fitted();
  EXPECT_TRUE(r.speed_recorded);
  expect_truth(r, 1e-3);
  r.droop = fit_droop({d.motion}, d.bases, r, 1);
  ASSERT_TRUE(r.droop->identifiable) << r.droop->why_not;
  EXPECT_NEAR(r.droop->rate.value, 130, 0.13);
  EXPECT_NEAR(r.droop->stall_torque.value, kStall, 2e-3 * kStall);
  const Parameters p = parse_parameters(
      fitted_parameters_toml(r, preset_parameters("paper"), {"x", "t", "s", "b", {}, ""}),
      "fit.toml");
  EXPECT_EQ(p.handpiece.model, HandpieceModel::kDroop);
  EXPECT_EQ(p.handpiece.rotation_rate, r.droop->rate.value);
  EXPECT_EQ(p.handpiece.stall_torque, r.droop->stall_torque.value);
}

TEST(Spindle, NoisySpeedLeavesTheDroopWithinItsInterval) {
  int held = 0;
  constexpr int kTrials = 4;
  for (std::uint64_t seed = 1; seed <= kTrials; ++seed) {
    SensorOptions s;
    s.noise = 0.05;
    s.speed_noise = 0.02;
    s.seed = seed;
    const Droop d(kStall, s);
    FitOptions o;
    o.diagnose = false;
    const FitResult r = d.fitted(o);
    const DroopFit droop = fit_droop({d.motion}, d.bases, r, seed);
    ASSERT_TRUE(droop.identifiable) << droop.why_not;
    std::printf("[ droop    ] N0 %.4f +- %.4f of the truth, stall torque %.4f +- %.4f\n",
                droop.rate.value / 130, droop.rate.std / 130, droop.stall_torque.value / kStall,
                droop.stall_torque.std / kStall);
    EXPECT_NEAR(droop.stall_torque.value, kStall, 4 * droop.stall_torque.std);
    EXPECT_LT(droop.stall_torque.std, 0.1 * kStall);
    held += droop.stall_torque.low <= kStall && kStall <= droop.stall_torque.high;
  }
  EXPECT_GE(held, kTrials - 1);  // 95 % each: two misses of four have a chance of 1.4 %
}

TEST(Spindle, SpeedThatDoesNotFallTellsNoDroop) {
  const Droop d(4000);  // falls by less than a thousandth
  SensorOptions s;
  s.speed_noise = 0.02;
  const Droop noisy(4000, s);
  const FitResult r = noisy.fitted();
  const DroopFit droop = fit_droop({noisy.motion}, noisy.bases, r, 1);
  EXPECT_FALSE(droop.identifiable);
  EXPECT_THAT(droop.why_not, HasSubstr("fall"));
  EXPECT_THAT(fit_droop({RecordedMotion{d.motion.path, {}}}, d.bases, r, 1).why_not,
              HasSubstr("no speed"));
}

// Above half the stall torque an imposed feed stalls: those samples obey another law, and are left
// out.
TEST(Spindle, StalledSamplesAreLeftOut) {
  const Droop d(1.7);
  ASSERT_GT(d.stalled, 100);
  const FitResult r = d.fitted();
  EXPECT_GE(r.recordings[0].stalled, static_cast<std::size_t>(d.stalled) / 2);
  expect_truth(r, 2e-3);
}

TEST(Spindle, SpeedThatIsGoneIsAStallThoughTheFileDoesNotSaySo) {
  Droop d(1.6);
  const std::vector<char> said = d.recording.stalled;
  d.recording.stalled.clear();
  check_recording(d.recording);
  EXPECT_EQ(d.recording.stalled, said);
}

TEST(Spindle, RecordedTorqueIsComparedWithTheModels) {
  Droop d(kStall);
  FitResult r = d.fitted();
  check_torque(d.recording, d.bases[0], r, r.recordings[0]);
  EXPECT_NEAR(r.recordings[0].torque_factor, 1, 1e-3);
  for (double& t : d.recording.torque) t *= 1.2;
  check_torque(d.recording, d.bases[0], r, r.recordings[0]);
  EXPECT_NEAR(r.recordings[0].torque_factor, 1.2, 2e-3);
}

}  // namespace
}  // namespace toothprep::testing
