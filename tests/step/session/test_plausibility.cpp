#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "toothprep/step/session/plausibility.h"

namespace toothprep {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// Five seconds of a hand's work at 1 kHz: loops of 2 mm at 10 mm/s.
std::vector<HandleSample> hand(double seconds_per_unit = 1, double mm_per_unit = 1) {
  std::vector<HandleSample> path(5001);
  for (std::size_t i = 0; i < path.size(); ++i) {
    const double t = 1e-3 * static_cast<double>(i);
    path[i].time = t / seconds_per_unit;
    path[i].pose.position = Vec3(2 * std::cos(5 * t), 2 * std::sin(5 * t), 1) / mm_per_unit;
  }
  return path;
}

std::vector<Implausible> kinds(const std::vector<Finding>& findings) {
  std::vector<Implausible> result;
  for (const Finding& f : findings) result.push_back(f.what);
  return result;
}

TEST(Plausibility, AHandsWorkAndThePresetsAreNotFound) {
  EXPECT_THAT(judge_motion(hand()), IsEmpty());
  for (const char* preset : kPresets)
    EXPECT_THAT(judge_parameters(preset_parameters(preset)), IsEmpty()) << preset;
  Parameters p = preset_parameters("paper");
  p.tissue[0].specific_energy = 0;  // allowed: no resistance
  p.handpiece.stall_torque = std::numeric_limits<double>::infinity();
  EXPECT_THAT(judge_parameters(p), IsEmpty());
}

TEST(Plausibility, EncoderStepsAndAReachingHandAreNotFound) {
  std::vector<HandleSample> path = hand();
  for (std::size_t i = 0; i < path.size(); ++i) {
    path[i].pose.position.y() += 0.3 * 1e3 * path[i].time / 5;  // 60 mm/s
    for (double& x : path[i].pose.position) x = 0.023 * std::round(x / 0.023);
  }
  EXPECT_THAT(judge_motion(path), IsEmpty());
}

TEST(Plausibility, MillisecondsTakenForSecondsAreNamed) {
  const auto findings = judge_motion(hand(1e-3));
  ASSERT_THAT(kinds(findings), ElementsAre(Implausible::kTimeStep));
  EXPECT_NEAR(findings[0].value, 1, 1e-9);  // s between samples
  EXPECT_THAT(findings[0].cause, HasSubstr("milliseconds"));
}

TEST(Plausibility, MetresAndMicrometresTakenForMillimetresAreNamed) {
  const auto metres = judge_motion(hand(1, 1e3));
  ASSERT_THAT(kinds(metres), ElementsAre(Implausible::kExtent));
  EXPECT_THAT(metres[0].cause, HasSubstr("metres read as millimetres"));
  const auto micrometres = judge_motion(hand(1, 1e-3));  // 4000 "mm" across
  ASSERT_THAT(kinds(micrometres), ElementsAre(Implausible::kSpeed));
  EXPECT_THAT(micrometres[0].cause, HasSubstr("micrometres"));
}

TEST(Plausibility, TimesInMinutesAreNamed) {
  const auto findings = judge_motion(hand(60));
  ASSERT_THAT(kinds(findings), ElementsAre(Implausible::kSpeed));
  EXPECT_NEAR(findings[0].value, 600, 1);  // 10 mm/s, sixty times too fast
  EXPECT_THAT(findings[0].cause, HasSubstr("times in another unit"));
}

TEST(Plausibility, OneDamagedSampleIsNamedWithItsTime) {
  std::vector<HandleSample> path = hand();
  path[2000].pose.position.x() = 1e20;
  const auto findings = judge_motion(path);
  ASSERT_THAT(kinds(findings), ElementsAre(Implausible::kPosition, Implausible::kSpeed));
  EXPECT_THAT(findings[0].text, HasSubstr("1 of 5001 samples"));
  EXPECT_THAT(findings[0].text, HasSubstr("2 s"));
  for (const Finding& f : findings) EXPECT_THAT(f.cause, HasSubstr("single samples are damaged"));
}

TEST(Plausibility, ASpinningQuaternionIsNamed) {
  std::vector<HandleSample> path = hand();
  for (std::size_t i = 0; i < path.size(); ++i)  // 20 turns a second
    path[i].pose.orientation = Quat(Eigen::AngleAxisd(2 * M_PI * 20 * path[i].time, Vec3::UnitZ()));
  const auto findings = judge_motion(path);
  ASSERT_THAT(kinds(findings), ElementsAre(Implausible::kTurning));
  EXPECT_NEAR(findings[0].value, 2 * M_PI * 20, 1e-3);
  EXPECT_THAT(findings[0].cause, HasSubstr("quaternion"));
  for (std::size_t i = 0; i < path.size(); ++i) {  // q and -q are the same turn
    path[i].pose.orientation = Quat::Identity();
    if (i % 2) path[i].pose.orientation.coeffs() *= -1;
  }
  EXPECT_THAT(judge_motion(path), IsEmpty());
}

TEST(Plausibility, SpecificEnergiesInOtherUnitsAreNamedWithWhatTheyWouldBe) {
  Parameters p = preset_parameters("paper");
  p.tissue[0].specific_energy = 0.3e9 * 1e3;  // 0.3 J/mm³ given as 3e8 J/m³
  const auto cubic = judge_parameters(p);
  ASSERT_THAT(kinds(cubic), ElementsAre(Implausible::kSpecificEnergy));
  EXPECT_THAT(cubic[0].cause, HasSubstr("J/m^3: it would be 0.3 J/mm^3"));
  p.tissue[0].specific_energy = 300e3;  // 0.3 J/mm³ given as 300 N/mm²
  EXPECT_THAT(judge_parameters(p)[0].cause, HasSubstr("it would be 0.3 J/mm^3"));
}

TEST(Plausibility, ParametersInOtherUnitsAreNamed) {
  Parameters p = preset_parameters("paper");
  p.tissue[1].force_ratio = 1e-9;
  p.handpiece.rotation_rate = 200'000;  // rpm
  p.handpiece.rotor_inertia = 1e-4;     // 100 g·mm²: 0.1 s at 100 rev/s
  EXPECT_THAT(kinds(judge_parameters(p)),
              ElementsAre(Implausible::kForceRatio, Implausible::kRotationRate,
                          Implausible::kRotorInertia));
  p.handpiece.rotor_inertia = 0;
  p.coupling.stiffness = 1000;  // N/m
  p.time_step = 1;              // ms
  const auto findings = judge_parameters(p);
  ASSERT_THAT(kinds(findings), ElementsAre(Implausible::kForceRatio, Implausible::kRotationRate,
                                           Implausible::kStiffness, Implausible::kStep));
  EXPECT_THAT(findings[0].text, HasSubstr("dentin"));
  EXPECT_THAT(findings[1].cause, HasSubstr("3333 rev/s"));
  EXPECT_THAT(findings[2].cause, HasSubstr("1 N/mm"));
}

Audit audit_of(double work, double energy, double volume,
               EngineKind engine = EngineKind::kLevelset) {
  Parameters p = preset_parameters("paper");
  p.engine = engine;
  return judge_audit(work, energy, {volume, 0, 0, 0}, p);
}

TEST(Plausibility, TheAuditIsJudgedByTheEnginesOwnLimits) {
  using Verdict = Audit::Verdict;
  EXPECT_EQ(audit_of(1.05, 1, 0.01).verdict, Verdict::kWithin);
  EXPECT_EQ(audit_of(1.15, 1, 0.01).verdict, Verdict::kOutside);
  EXPECT_EQ(audit_of(0.85, 1, 0.01).verdict, Verdict::kOutside);
  EXPECT_EQ(audit_of(0, 450, 1.5).verdict, Verdict::kOutside);
  EXPECT_EQ(audit_of(-12994, 450, 1.5).verdict, Verdict::kOutside);
  EXPECT_EQ(audit_of(std::nan(""), 450, 1.5).verdict, Verdict::kOutside);
  EXPECT_EQ(audit_of(1.5, 1, 0.01, EngineKind::kVoxel).verdict, Verdict::kWithin);
  EXPECT_EQ(audit_of(1.9, 1, 0.01, EngineKind::kVoxel).verdict, Verdict::kOutside);
  EXPECT_EQ(audit_of(0.85, 1, 0.01, EngineKind::kVoxel).verdict, Verdict::kOutside);
  EXPECT_EQ(audit_of(5, 0, 0).verdict, Verdict::kOutside);  // work that removed nothing
}

TEST(Plausibility, TooLittleToJudgeIsNotJudgedAndSaysWhy) {
  EXPECT_EQ(audit_of(0.004, 0.009, 3e-5).verdict, Audit::Verdict::kNotJudged);
  EXPECT_THAT(audit_text(audit_of(0, 0, 0)), HasSubstr("nothing was removed"));
  // Tissue without resistance: a removed volume is never "nothing".
  const std::string text = audit_text(audit_of(0, 0, 1.5));
  EXPECT_THAT(text, HasSubstr("the specific energy of what was removed is 0"));
  EXPECT_THAT(text, ::testing::Not(HasSubstr("nothing")));
  EXPECT_THAT(audit_text(audit_of(0.004, 0.009, 3e-5)), HasSubstr("less than 0.01 mJ"));
  Parameters literal = preset_parameters("paper");
  literal.rotation_feed = false;
  EXPECT_EQ(judge_audit(2, 1, {0.01, 0, 0, 0}, literal).verdict, Audit::Verdict::kNotJudged);
}

TEST(Plausibility, WhatShowsInTheResultsIsPutDownToTheInputs) {
  const auto findings =
      judge_run(judge_motion(hand(1e-3)), audit_of(0, 450, 1.5), 2.6e6, 1, Drive::kCoupled);
  ASSERT_THAT(kinds(findings),
              ElementsAre(Implausible::kTimeStep, Implausible::kForce, Implausible::kEnergyAudit));
  EXPECT_THAT(message_of(findings[2]), HasSubstr("milliseconds"));
  const auto lag = judge_run({}, audit_of(1, 1, 0.01), 60, 60, Drive::kCoupled);
  ASSERT_THAT(kinds(lag), ElementsAre(Implausible::kForce));
  EXPECT_THAT(lag[0].cause, HasSubstr("60 mm behind the handle"));
  EXPECT_THAT(judge_run({}, audit_of(1, 1, 0.01), 5, 4, Drive::kCoupled), IsEmpty());
}

}  // namespace
}  // namespace toothprep
