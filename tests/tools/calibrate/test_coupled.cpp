#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "experiment.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/session/replay.h"
#include "toothprep/tools/calibrate/coupled.h"

namespace toothprep::testing {
namespace {

// A copy's recordings would refer to the bases of what it was copied from.
static_assert(!std::is_copy_constructible_v<CoupledFit> && !std::is_copy_assignable_v<CoupledFit>);
static_assert(
    std::is_nothrow_move_assignable_v<std::deque<ForceBasis>>);  // they stay where they are

using ::testing::HasSubstr;

// Of the handle: a slot in enamel, one in dentin and one in both, with plunges between; the handle
// waits until the bur has come after it.
std::vector<HandleSample> handle_path() {
  return legs({-3.6, -0.8, -1.0},
              {{{-3.5, -0.8, -1.0}, 1.0},
               {{1.0, -0.8, -1.0}, 2.0},
               {{1.02, -0.8, -1.0}, 0.03},
               {{1.02, -2.4, -1.0}, 1.0},
               {{1.02, -2.42, -1.0}, 0.02},
               {{0.0, -2.0, 1.0}, 1.6},
               {{0.0, -2.0, 1.02}, 0.02},
               {{0.0, 0.6, 1.02}, 6.0}},
              250);
}

// Pushed ahead until the bur stalls, and pulled back so that it starts again.
std::vector<HandleSample> stalling_path() {
  return legs({-3.6, -0.8, -1.0},
              {{{-1.5, -0.8, -1.0}, 0.5},
               {{1.5, -0.8, -1.0}, 4.0},
               {{-2.0, -0.8, -1.0}, 4.0},
               {{-0.5, -0.8, -1.0}, 0.5},
               {{-0.5, 0.6, -1.0}, 4.0},
               {{-3.6, 0.6, 1.2}, 8.0},
               {{-3.6, -2.0, 1.2}, 8.0},
               {{-1.6, -2.0, 1.2}, 0.4},
               {{-1.6, 0.6, 1.2}, 4.0}},
              250);
}

Parameters rig(double stall_torque = 1.2) {
  Parameters p = preset_parameters("paper");
  p.time_step = 0.004;
  p.coupling.stiffness = 2;
  p.handpiece.stall_torque = stall_torque;
  return p;
}

struct Rig {
  std::vector<HandleSample> path;
  Parameters parameters;
  ReplayResult run;
  MeasuredRecording recording;

  explicit Rig(const Parameters& p, const SensorOptions& sensor = {},
               std::vector<HandleSample> way = handle_path())
      : path(std::move(way)), parameters(p) {
    Parameters true_parameters = p;
    true_parameters.tissue = truth();
    Workpiece workpiece(tooth());
    run = replay(cylinder(), workpiece, true_parameters, Drive::kCoupled, path);
    std::vector<Vec3> force;
    for (const StepRecord& row : run.rows) force.push_back(row.grinding_force);
    recording = recorded(path, measured_by(sensor, force, p.time_step));
  }
  static const LayeredTooth& tooth() {
    static const LayeredTooth block = block_with(1.0);
    return block;
  }
  CoupledFit fitted(const FitOptions& o = {}, const CoupledOptions& c = {}) const {
    return fit_coupled(cylinder(), tooth(), parameters, {recording},
                       {motion_of(recording, parameters.time_step, false, false)}, o, c);
  }
};

void print(const CoupledFit& r) {
  for (const CoupledIteration& i : r.iterations)
    std::printf(
        "[ coupled  ] enamel %.5f %.5f, dentin %.5f %.5f of the truth; misfit %.2e N; change "
        "%.1e\n",
        i.tissue[0].specific_energy / truth()[0].specific_energy,
        i.tissue[0].force_ratio / truth()[0].force_ratio,
        i.tissue[1].specific_energy / truth()[1].specific_energy,
        i.tissue[1].force_ratio / truth()[1].force_ratio, i.misfit, i.change);
  for (const std::string& w : r.fit.warnings) std::printf("[ coupled  ]   %s\n", w.c_str());
}

TEST(Coupled, HandleRecordingWithoutNoiseIsRecoveredToATenthOfAPercent) {
  const Rig r(rig());
  EXPECT_EQ(r.run.totals.stalled_steps, 0);
  EXPECT_GT(r.run.totals.largest_lag, 1);  // far from the handle, so its motion alone means nothing
  const CoupledFit fitted = r.fitted();
  print(fitted);
  expect_truth(fitted.fit, 1e-3);
}

// A bur that stalls waits for the handle; the replay does the same at the right place, though the
// recording doesn't say so.
TEST(Coupled, StallsOfTheBurAreReplayedNotFitted) {
  const Rig r(rig(0.6), {}, stalling_path());
  EXPECT_GT(r.run.totals.stalled_steps, 50);
  const CoupledFit fitted = r.fitted();
  print(fitted);
  EXPECT_NEAR(fitted.stalled, 0.004 * static_cast<double>(r.run.totals.stalled_steps), 0.05);
  expect_truth(fitted.fit, 1e-3);
}

// 2 % of noise, bias and a delay: within three of the stated standard deviations, and those small.
TEST(Coupled, NoiseBiasAndDelayLeaveAFewPercent) {
  SensorOptions s;
  s.noise = 0.02;
  s.bias = Vec3(0.1, -0.05, 0.02);
  s.delay = 0.004;
  s.seed = 3;
  const Rig r(rig(), s);
  FitOptions o;
  o.estimate_delay = true;
  const CoupledFit fitted = r.fitted(o);
  print(fitted);
  expect_truth(fitted.fit, 0.1);
  EXPECT_NEAR(fitted.fit.delay.value, 0.004, 0.002);
  for (const int k : {0, 1}) {
    const TissueFit& t = fitted.fit.tissue[k];
    EXPECT_NEAR(t.u.value, truth()[k].specific_energy, 3 * t.u.std);
    EXPECT_NEAR(t.alpha.value, truth()[k].force_ratio, 3 * t.alpha.std);
    EXPECT_LT(t.u.std, 0.1 * t.u.value);
  }
  CoupledOptions impatient;
  impatient.most_iterations = 1;
  try {
    r.fitted(o, impatient);
    FAIL() << "one iteration can't have converged";
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), HasSubstr("do not converge"));
  }
}

}  // namespace
}  // namespace toothprep::testing
