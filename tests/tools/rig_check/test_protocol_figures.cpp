// Active checks run on the simulated device, whose limits are known (tools/device/README.md).
#include <gtest/gtest.h>

#include "made_recording.h"
#include "toothprep/tools/rig_check/protocol_figures.h"

namespace toothprep {
namespace {

using testing::made_header;
using testing::run_probe;

const RigMethod kMethod;

SimulatedSettings desktop(HandMotion motion) {
  SimulatedSettings s;
  s.real_time = false;
  s.motion = std::move(motion);
  s.hand.mass = 0;
  return s;
}
HandMotion pulled(double speed) {
  return [speed](double time) {
    DevicePose pose;
    pose.position = Vec3(0.01 + speed * time, 0, 0);
    return pose;
  };
}

// A hand of k_h pulls back: the handle comes to rest where k_h x is within friction of the force.
TEST(StepCheck, TheHandleGivesWayAsTheHandsSpringLetsIt) {
  const Protocol p = parse_protocol("step 0.5 N for 2 s");
  const SimulatedSettings settings = desktop(resting_hand(DevicePose()));
  const SessionRecording r = run_probe(
      settings, made_header(print_protocol(p)),
      [&](double time, const Vec3&, const Vec3&) {
        return Vec3(0, protocol_step_on(p, time) ? p.force_n : 0, 0);
      },
      protocol_duration(p));
  const auto f = step_figures(r, p);
  ASSERT_TRUE(f) << f.why_not;
  EXPECT_NEAR(f->force, 0.5, 1e-12);
  EXPECT_NEAR(f->force_error_percent, 0, 1e-9);
  EXPECT_EQ(f->latency_ticks, 0);
  const double count = 0.023, friction = 0.06, stiffness = 0.3;
  EXPECT_NEAR(f->displacement, 0.5 / stiffness, friction / stiffness + count);
  // Slower than the quarter period of m and k_h (2.5 * sqrt(45e-6/0.3) = 30 ms undamped to 90 %)
  // is not possible by much: the hand's 2 N·s/m damp a fifth of critical.
  EXPECT_GT(f->rise_time, 0.005);
  EXPECT_LT(f->rise_time, 0.1);
}

TEST(StepCheck, AStepThatWasNotFinishedIsSaid) {
  const Protocol p = parse_protocol("step 0.5 N for 2 s");
  SessionRecording r = testing::made_recording(1600, print_protocol(p));
  EXPECT_EQ(step_figures(r, p).why_not, "the recording ends before the step does");
}

TEST(StepCheck, ADelayOfTheDeviceIsSeenInTicks) {
  const Protocol p = parse_protocol("step 0.5 N for 2 s");
  SessionRecording r = testing::made_recording(3000, print_protocol(p));
  for (std::size_t i = 0; i < 3000; ++i) {
    const double time = r.header.trace.rows[i].handle.time;
    if (protocol_step_on(p, time)) r.force_commanded[i] = Vec3(0.5, 0, 0);
    // Row i has what was sent in the tick before; two ticks of delay.
    if (i >= 3 && protocol_step_on(p, r.header.trace.rows[i - 3].handle.time))
      r.force_sent[i] = Vec3(0.49, 0, 0);
  }
  const auto f = step_figures(r, p);
  ASSERT_TRUE(f) << f.why_not;
  EXPECT_EQ(f->latency_ticks, 2);
  EXPECT_NEAR(f->force_error_percent, -2, 1e-9);
}

SweepFigures damping_sweep(const std::string& words, const HandMotion& motion) {
  const Protocol p = parse_protocol(words);
  const SessionRecording r = run_probe(
      desktop(motion), made_header(words),
      [&](double time, const Vec3&, const Vec3& step) -> Vec3 {
        const auto level = protocol_level_at(p, time);
        if (!level) return Vec3::Zero();
        return -protocol_level(p, *level) * 1e-3 / testing::kPeriod * step;
      },
      protocol_duration(p));
  const auto f = sweep_figures(r, p, kMethod, 0.023);
  return f ? *f : SweepFigures();
}

// Known of the simulated Desktop at 0.5 mm/s: stable up to 5 N·s/m, vibrating at 10 to 60, motors
// at their limit from 86.
TEST(DampingSweep, FindsTheLimitsOfDirectRendering) {
  const SweepFigures f =
      damping_sweep("damping-sweep 2..112 N*s/m in 5 geometric steps of 2 s", pulled(0.5));
  ASSERT_EQ(f.levels.size(), 5u);  // 2, 5.5, 15, 41, 112
  EXPECT_EQ(f.levels[0].verdict, LevelVerdict::kStable);
  EXPECT_EQ(f.levels[2].verdict, LevelVerdict::kVibrates);
  EXPECT_EQ(f.levels[3].verdict, LevelVerdict::kVibrates);
  EXPECT_EQ(f.levels[4].verdict, LevelVerdict::kUnstable);
  ASSERT_TRUE(f.last_stable && f.first_vibrating && f.first_unstable);
  EXPECT_LE(*f.last_stable, 5.5);
  EXPECT_EQ(*f.first_unstable, f.levels[4].level);
  // At 2 N·s/m each count is a pulse of B D/T.
  EXPECT_NEAR(f.levels[0].peak_to_peak, 2e-3 * 0.023 / 1e-3, 1e-9);
  EXPECT_NEAR(f.levels[0].speed, 0.5, 0.05);
}

TEST(DampingSweep, AHandThatRestsShowsNothing) {
  const SweepFigures f =
      damping_sweep("damping-sweep 1..4 N*s/m in 2 steps of 1 s", resting_hand(DevicePose()));
  EXPECT_TRUE(f.levels.empty());
}

// Known: a held spring is stable up to 5.25 N/mm and moves backward from 5.5 on. What it does then
// is a count back and forth, k D = 0.12 N and more: felt (0.05 N rms) only a little later.
TEST(StiffnessSweep, FindsTheLimitOfASampledSpring) {
  const std::string words = "stiffness-sweep 1..9 N/mm in 5 steps of 2 s";
  const Protocol p = parse_protocol(words);
  SimulatedSettings settings = desktop(pulled(0.5));
  const SessionRecording r = run_probe(
      settings, made_header(words),
      [&, start = Vec3(0.01, 0, 0)](double time, const Vec3& place, const Vec3&) -> Vec3 {
        const auto level = protocol_level_at(p, time);
        return level ? Vec3(-protocol_level(p, *level) * (place - start)) : Vec3(0, 0, 0);
      },
      protocol_duration(p));
  const auto f = sweep_figures(r, p, kMethod, 0.023);
  ASSERT_TRUE(f) << f.why_not;
  for (const int stable : {0, 1, 2})  // 1, 3, 5 N/mm
    EXPECT_EQ(f->levels[static_cast<std::size_t>(stable)].verdict, LevelVerdict::kStable);
  EXPECT_EQ(f->levels[4].verdict, LevelVerdict::kVibrates) << f->levels[4].rms_above_20;
  ASSERT_TRUE(f->last_stable);
  EXPECT_GE(*f->last_stable, 5);
  EXPECT_LT(*f->last_stable, 9);
}

TEST(Sweep, AGovernorThatTakesAVibratingForceAwayMakesItsLevelUnstable) {
  const std::string words = "damping-sweep 1..4 N*s/m in 4 steps of 1 s";
  const Protocol p = parse_protocol(words);
  SessionRecording r = testing::made_recording(5000, words);
  for (std::size_t i = 1000; i < 5000; ++i) {
    r.device_position[i][0] = 2e-3 * static_cast<double>(i);  // 2 mm/s
    const bool vibrates = i >= 2000 && i < 2300;              // in level 1
    if (i < 2300)
      r.force_sent[i + 1][0] = -0.01 + (vibrates ? (i / 5 % 2 ? 1.0 : -1.0) : 1e-3 * (i % 2));
    else
      r.flags[i] = kForceWithheld;
  }
  const auto f = sweep_figures(r, p, kMethod, 0.023);
  ASSERT_TRUE(f);
  EXPECT_EQ(f->levels[0].verdict, LevelVerdict::kStable);
  EXPECT_EQ(f->levels[1].verdict, LevelVerdict::kUnstable);
  EXPECT_NEAR(f->levels[1].rms_above_20, 1, 0.05);  // a square wave of 100 Hz and 1 N
  EXPECT_EQ(f->levels[2].verdict, LevelVerdict::kNotRun);
  EXPECT_EQ(f->last_stable, 1);
  EXPECT_EQ(f->first_unstable, 2);

  // The same without vibration is somebody who stopped.
  for (std::size_t i = 2000; i < 2300; ++i) r.force_sent[i + 1][0] = -0.01;
  EXPECT_EQ(sweep_figures(r, p, kMethod, 0.023)->levels[1].verdict, LevelVerdict::kNotRun);
}

// The session ends 50 ms into the level, when a watch over it has seen enough.
TEST(Sweep, ALevelThatEndsTheSessionByVibratingIsUnstable) {
  const std::string words = "damping-sweep 1..4 N*s/m in 4 steps of 1 s";
  const Protocol p = parse_protocol(words);
  for (const double amplitude : {1.0, 0.01}) {
    SessionRecording r = testing::made_recording(2052, words);
    for (std::size_t i = 1000; i + 1 < 2052; ++i) {
      r.device_position[i][0] = 2e-3 * static_cast<double>(i);
      r.force_sent[i + 1][0] = i < 2000 ? -0.01 + 1e-3 * (i % 2) : (i % 2 ? 1 : -1) * amplitude;
    }
    EXPECT_EQ(sweep_figures(r, p, kMethod, 0.023)->levels[1].verdict,
              amplitude > 0.5 ? LevelVerdict::kUnstable : LevelVerdict::kNotRun);
  }
}

// The hand's intended place sinks 4 mm behind the plane; k_h and k in series, friction between.
TEST(Wall, PenetrationFollowsForceOverStiffness) {
  const Protocol p = parse_protocol("wall 1 N/mm travel 3 mm for 4 s");
  SimulatedSettings settings = desktop([](double time) {
    DevicePose pose;
    pose.position = Vec3(0, 1 - 5 * std::min(1.0, std::max(0.0, time - 1) / 3), 0);
    return pose;
  });
  const SessionRecording r = run_probe(
      settings, made_header(print_protocol(p)),
      [&](double time, const Vec3& place, const Vec3&) {
        const double depth = time < kProtocolLead ? 0 : std::clamp(-place[1], 0.0, p.travel_mm);
        return Vec3(0, p.stiffness_n_per_mm * depth, 0);
      },
      protocol_duration(p));
  const auto f = wall_figures(r, p);
  ASSERT_TRUE(f) << f.why_not;
  EXPECT_NEAR(f->stiffness_ratio, 1, 1e-9);  // the force answers the very reading
  EXPECT_NEAR(f->penetration, f->penetration_theory, 1e-9);
  EXPECT_NEAR(f->penetration, 4 * 0.3 / 1.3, 0.06 / 1.3 + 0.023);
  EXPECT_LT(f->vibration_rms, 0.05);
  EXPECT_GT(f->contact_seconds, 1);
}

TEST(Wall, AWallThatGivesWayIsSeen) {
  const Protocol p = parse_protocol("wall 1 N/mm travel 3 mm for 4 s");
  SessionRecording r = testing::made_recording(4000, print_protocol(p));
  for (std::size_t i = 1000; i + 1 < 4000; ++i) {
    const double depth = 1 - std::cos(static_cast<double>(i - 1000) * 2e-3);
    r.device_position[i][1] = 5 - depth;
    r.force_sent[i + 1][1] = 0.8 * depth;
  }
  const auto f = wall_figures(r, p);
  ASSERT_TRUE(f);
  EXPECT_NEAR(f->stiffness_ratio, 0.8, 1e-9);
  EXPECT_NEAR(f->penetration / f->penetration_theory, 1 / 0.8, 1e-6);
  EXPECT_FALSE(wall_figures(testing::made_recording(4000), p));
}

}  // namespace
}  // namespace toothprep
