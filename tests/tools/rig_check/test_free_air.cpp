// A healthy coupled session on the simulated device, with its real counts: its energy at the
// device's port must pass, however long the way.
#include <gtest/gtest.h>

#include <cmath>

#include "made_recording.h"
#include "toothprep/proof/specimen/block.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/session/session.h"
#include "toothprep/tools/rig_check/rig_figures.h"

namespace toothprep {
namespace {

using testing::run_probe;

constexpr double kSeconds = 9;
constexpr double kAmplitude = 6, kFrequency = 0.45;  // mm, Hz: some 12 mm/s

// The handle moves 20 mm above a block; `gain` (of the step's motion, N/mm) is added to the
// coupling's force.
SessionRecording moved_in_free_air(double gain) {
  BlockOptions block;
  block.size = Vec3(2, 2, 2);
  block.voxel = 0.2;
  const LayeredTooth tooth = make_block(block);
  Workpiece workpiece(tooth);
  const Vec3 above(0, 20, 0);
  HandleSample start;
  start.pose.position = above;
  start.buttons = kPedalButton;
  Session session(make_bur("cylinder:D1.2xL3.0", ""), workpiece, preset_parameters("paper"),
                  Drive::kCoupled, start);
  SimulatedSettings settings;
  settings.real_time = false;
  settings.motion = [](double t) {
    DevicePose pose;
    const double phase = 2 * units::kPi * kFrequency * t;
    pose.position = kAmplitude * Vec3(std::sin(phase), std::sin(1.7 * phase) / 2, 0);
    return pose;
  };
  std::vector<StepRecord> rows;
  SessionRecording r = run_probe(
      settings, testing::made_header(),
      [&](double time, const Vec3& place, const Vec3& step) -> Vec3 {
        HandleSample sample = start;
        sample.time = time;
        sample.pose.position = above + place;
        rows.push_back(rows.empty() ? session.initial() : session.step(sample));
        return rows.back().device_force + gain * step;
      },
      kSeconds);
  rows.resize(r.header.trace.rows.size());
  r.header.trace.rows = std::move(rows);
  return r;
}

double path_length(const SessionRecording& r) {
  double length = 0;
  for (std::size_t i = 1; i < r.device_position.size(); ++i)
    length += (r.device_position[i] - r.device_position[i - 1]).norm();
  return length;
}

TEST(FreeAir, WhatTheCountsFeedInIsExplained) {
  const SessionRecording r = moved_in_free_air(0);
  const auto spring = port_spring(r, preset_parameters("paper"));
  const auto f = device_port_figures(r, spring);
  ASSERT_TRUE(f);
  EXPECT_GT(path_length(r), 90);
  EXPECT_LT(f->peak_force, 0.06);
  // The observer alone takes it for an active world: it grows with the path.
  EXPECT_LT(f->minimum, -0.2);
  EXPECT_GT(f->largest_return, 100 * f->store);
  // No step is larger than a few counts, and each count is k q²/2.
  constexpr double kCount = 0.023;
  EXPECT_GT(f->sampling, path_length(r) / kCount * spring.stiffness * kCount * kCount / 2 * 0.9);
  EXPECT_GT(f->unexplained_minimum, -1e-9);
  EXPECT_LT(f->unexplained_return, f->store);
}

TEST(FreeAir, AnActiveWorldIsNotExplained) {
  const SessionRecording r = moved_in_free_air(2);
  const auto f = device_port_figures(r, port_spring(r, preset_parameters("paper")));
  ASSERT_TRUE(f);
  EXPECT_LT(f->unexplained_minimum, -0.2);
}

}  // namespace
}  // namespace toothprep
