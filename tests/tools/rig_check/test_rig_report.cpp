// From a device with known imperfections to the lines of the report.
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "made_recording.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/strict_toml.h"
#include "toothprep/tools/rig_check/rig_report.h"

namespace toothprep {
namespace {

using testing::kPeriod;
using testing::made_header;
using testing::run_probe;

RigLimits shipped() {
  return read_rig_limits(std::string(TOOTHPREP_SOURCE_DIR) + "/data/rig/limits.toml");
}
const auto kNoReplay = Measured<std::vector<StepRecord>>::no("no tooth was given");

const RigLine& line(const RigReport& report, const std::string& key) {
  for (const RigLine& l : report.lines)
    if (l.figure->key == key) return l;
  throw std::runtime_error("no line " + key);
}
double value(const RigReport& report, const std::string& key) {
  return line(report, key).value.value_or(std::nan(""));
}

// 20 s at rest on a device that is late by up to 200 us, leaves out every 250th tick and has 0.03
// mm of white noise before its counts of 0.023 mm.
TEST(RigReport, TellsTheImperfectionsThatTheDeviceWasGiven) {
  SimulatedSettings settings;
  settings.real_time = false;
  settings.motion = resting_hand(DevicePose());
  settings.disturbances.jitter = 200e-6;
  settings.disturbances.missed_every = 250;
  settings.disturbances.encoder_noise = 0.03;
  const SessionRecording r = run_probe(
      settings, made_header("rest 20 s"),
      [](double, const Vec3&, const Vec3&) { return Vec3(0, 0, 0); }, 20);
  const RigReport report = check_rig(r, shipped(), kNoReplay);

  // 20000 periods, of which the 250th, 500th, ... don't come; the very last is not in the file.
  EXPECT_EQ(value(report, "servo_missed_ticks"), 79);
  EXPECT_EQ(value(report, "servo_missed_ticks_by_device"), 79);
  EXPECT_EQ(line(report, "servo_missed_share").verdict, RigVerdict::kFail);
  // 0.3 % of scatter, see the test of the jitter.
  EXPECT_NEAR(value(report, "servo_jitter_rms_us") / (200 / std::sqrt(12.0)), 1, 0.016);
  EXPECT_EQ(line(report, "servo_jitter_rms_us").verdict, RigVerdict::kPass);
  EXPECT_NEAR(value(report, "servo_clock_error_ppm"), 0, 0.5);
  EXPECT_NEAR(value(report, "servo_late_share"), 79.0 / 19919, 1e-9);
  EXPECT_NEAR(value(report, "encoder_quantum_mm"), 0.023, 1e-9);
  EXPECT_NEAR(value(report, "encoder_noise_above_quantum_mm") / 0.03, 1, 0.05);
  EXPECT_EQ(line(report, "encoder_noise_above_quantum_mm").verdict, RigVerdict::kFail);
  const double noise = std::hypot(0.03, 0.023 / std::sqrt(12.0));
  EXPECT_NEAR(value(report, "velocity_noise_rms_mm_s") / (std::sqrt(2.0) * noise / kPeriod), 1,
              0.03);
  EXPECT_NEAR(value(report, "velocity_quantum_mm_s"), 23, 1e-6);
  EXPECT_EQ(line(report, "wall_stiffness_ratio").why_not, "needs a recording of the protocol wall");
  EXPECT_EQ(line(report, "replay_differing_rows").verdict, RigVerdict::kNotMeasured);
  EXPECT_EQ(report.overall, RigVerdict::kFail);
}

TEST(RigReport, APerfectDevicePassesAndEveryLineHasAValueOrAReason) {
  SimulatedSettings settings;
  settings.real_time = false;
  settings.motion = gentle_hand(DevicePose(), Vec3(10, 5, 10), 0.25);
  const SessionRecording r = run_probe(
      settings, made_header(),
      [](double, const Vec3& place, const Vec3&) -> Vec3 { return -0.02 * place; }, 4);
  const RigReport report = check_rig(r, shipped(), kNoReplay);
  EXPECT_EQ(report.lines.size(), rig_catalogue().size());
  for (const RigLine& l : report.lines)
    EXPECT_NE(l.value.has_value(), !l.why_not.empty()) << l.figure->key;
  EXPECT_EQ(value(report, "encoder_quantum_mm") > 0.02, true);
  EXPECT_EQ(line(report, "device_port_unexplained_minimum_mj").verdict, RigVerdict::kPass);
  EXPECT_GT(value(report, "device_port_return_mj"), 0.1);  // a spring gives back
  EXPECT_EQ(line(report, "coupling_margin").verdict, RigVerdict::kPass);
  for (const RigLine& l : report.lines) {
    const std::string key = l.figure->key;  // two are of the coupling, which these rows lack
    if (key == "lag_law_residual_mm" || key == "device_port_unexplained_return_over_store")
      continue;
    EXPECT_NE(l.verdict, RigVerdict::kFail) << l.figure->key << " " << *l.value;
  }
}

// A world that pushes the way the hand goes.
TEST(RigReport, AnActiveWorldFailsAtTheDevicesPort) {
  SimulatedSettings settings;
  settings.real_time = false;
  settings.motion = gentle_hand(DevicePose(), Vec3(10, 5, 10), 1);
  const SessionRecording r = run_probe(
      settings, made_header(),
      [](double, const Vec3&, const Vec3& step) -> Vec3 { return 1e-3 / kPeriod * step; }, 4);
  const RigReport report = check_rig(r, shipped(), kNoReplay);
  EXPECT_LT(value(report, "device_port_unexplained_minimum_mj"), -1);
  EXPECT_EQ(line(report, "device_port_unexplained_minimum_mj").verdict, RigVerdict::kFail);
}

TEST(RigReport, WhatACheckProvokesIsToldNotJudged) {
  SessionRecording r = testing::made_recording(4000, "damping-sweep 1..2 N*s/m in 2 steps of 1 s");
  for (std::size_t i = 1500; i < 2000; ++i) {
    r.flags[i] |= kForceClamped;
    r.device_position[i] = Vec3(1e-3 * static_cast<double>(i - 1500), 0, 0);
    r.force_sent[i] = Vec3(7.9, 0, 0);
  }
  const RigReport sweep = check_rig(r, shipped(), kNoReplay);
  EXPECT_LT(value(sweep, "device_port_unexplained_minimum_mj"), -1);
  EXPECT_EQ(line(sweep, "device_port_unexplained_minimum_mj").verdict, RigVerdict::kNoLimit);
  EXPECT_EQ(line(sweep, "force_clamped_share").verdict, RigVerdict::kNoLimit);
  EXPECT_EQ(line(sweep, "lag_law_residual_mm").why_not, "an active check renders no tooth");
  r.header.protocol.clear();
  EXPECT_EQ(line(check_rig(r, shipped(), kNoReplay), "force_clamped_share").verdict,
            RigVerdict::kFail);
}

TEST(RigReport, LimitsDecideAndTheirLackDoesNot) {
  const SessionRecording r = testing::made_recording(1000);
  RigLimits limits = shipped();
  limits.limits.clear();
  EXPECT_EQ(check_rig(r, limits, kNoReplay).overall, RigVerdict::kNotMeasured);
  limits.limits["servo_period_median_us"] = {999.0, 1001.0, "test"};
  EXPECT_EQ(check_rig(r, limits, kNoReplay).overall, RigVerdict::kPass);
  limits.limits["servo_period_worst_us"] = {{}, 500.0, "test"};
  const RigReport report = check_rig(r, limits, kNoReplay);
  EXPECT_EQ(report.overall, RigVerdict::kFail);
  EXPECT_EQ(report.passed, 1);
  EXPECT_EQ(report.failed, 1);
}

TEST(RigReport, AProtocolThatDoesNotParseIsAnError) {
  EXPECT_THROW(check_rig(testing::made_recording(1000, "dance 3 s"), shipped(), kNoReplay), Error);
}

TEST(RigReport, JsonAndTablesHoldWhatTheReportHolds) {
  const SessionRecording r = testing::made_recording(5000, "rest 4 s");
  const RigReport report = check_rig(r, shipped(), kNoReplay);
  const auto j = nlohmann::json::parse(report_json(report, r, "a.h5", "1.2", "Release"));
  EXPECT_EQ(j["schema"], "toothprep-rig-check");
  EXPECT_EQ(j["ticks"], 5000);
  EXPECT_EQ(j["lines"].size(), rig_catalogue().size());
  EXPECT_NEAR(j["servo_period_median_us"].get<double>(), 1000, 1e-6);
  EXPECT_TRUE(j["wall_penetration_mm"].is_null());
  const auto folder = std::filesystem::path(TOOTHPREP_BINARY_DIR) / "test-rig-tables";
  std::filesystem::create_directories(folder);
  write_plot_data(report, r, folder.string());
  const std::string trace = read_small_text((folder / "trace.csv").string());
  EXPECT_EQ(std::count(trace.begin(), trace.end(), '\n'), 2501);
  EXPECT_TRUE(std::filesystem::exists(folder / "periods.csv"));
  EXPECT_FALSE(std::filesystem::exists(folder / "levels.csv"));
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace toothprep
