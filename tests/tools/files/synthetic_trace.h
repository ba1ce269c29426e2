// A trace without a simulation behind it: every field of every row is another number, so that a
// swapped column can't go unnoticed, while the curves look like a cut (for plot-trace).
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "toothprep/step/core/parameters.h"
#include "toothprep/tools/files/trace.h"

namespace toothprep {

inline Trace synthetic_trace(int rows) {
  Trace trace;
  trace.parameters_toml = to_toml(preset_parameters("paper"));
  trace.tooth_sha256 = std::string(64, 'a');
  trace.toothprep_version = "0.0.0";
  trace.bur = "cylinder:D1.2xL3.0";
  trace.drive = "coupled";
  trace.engine = "levelset";
  trace.audit = {0.1 + 0.2, 1.0 / 3.0, 0.9};
  trace.initial_overlap_mm3 = 0.0625;
  double enamel = 0, dentin = 0;
  for (int i = 0; i < rows; ++i) {
    const double t = i * 1e-3, end = rows * 1e-3, s = t / end;
    const double wave = std::sin(0.37 * i);
    const double depth = 1 - std::exp(-6 * s);
    StepRecord row;
    row.handle.time = t;
    row.handle.pose.position = Vec3(0.01 * wave, 4 - 0.5 * t, 0.1 / (i + 1.0));
    row.handle.pose.orientation =
        Quat(Eigen::AngleAxisd(0.3 + 0.01 * s, Vec3(1, 2, 3).normalized()));
    row.handle.buttons = i % 97 ? 1u : 0x80000001u;
    row.handle.rejected = i % 89 == 88;
    row.bur.position = row.handle.pose.position + Vec3(0.05, 3 * depth * (s < 0.8), 0.02);
    row.bur.orientation = Quat(Eigen::AngleAxisd(0.2, Vec3(3, 1, 2).normalized()));
    row.stalled = i > 0 && s > 0.62 && s < 0.74;
    row.stalled_fraction = row.stalled ? (s < 0.63 ? 0.125 : 1) : 0;
    row.bur_velocity = row.stalled ? Vec3(0, 0, 0) : Vec3(0.001 * wave, -0.5 * depth, 1e-5 * i);
    if (i > 0) {
      const double hard = s < 0.45 ? 1.0 : 1.0 / 3.0;
      row.grinding_force =
          hard * depth * Vec3(1.125, 4.5 + (row.stalled ? 30 * (s - 0.62) : 0), 0.1 * wave);
      row.device_force = row.grinding_force + Vec3(0.02 * wave, 0.015 * wave, -0.01);
      row.torque = row.stalled ? 1.2 : hard * depth * 0.8594;
      row.torque_trial = row.stalled ? 1.2 + 2 * (s - 0.62) : row.torque;
      row.rotation_rate = row.stalled ? 0 : 100;
      row.power = 2 * 3.14159265358979 * row.rotation_rate * row.torque;
      row.contact_area = {s < 0.5 ? 5.65 * depth : 0, s > 0.45 ? 5.65 : 0, 1e-3 * s, 2e-3 * s};
      enamel += row.stalled ? 0 : row.contact_area[0] * 0.5e-3;
      dentin += row.stalled ? 0 : row.contact_area[1] * 0.5e-3;
      row.shank_contact_area = 3e-3 * s;
    }
    row.removed_volume = {enamel, dentin, 1e-4 * s, 2e-4 * s};
    trace.rows.push_back(row);
  }
  return trace;
}

inline void expect_same_rows(const Trace& a, const Trace& b) {
  ASSERT_EQ(a.rows.size(), b.rows.size());
  for (std::size_t i = 0; i < a.rows.size(); ++i) {
    const StepRecord &x = a.rows[i], &y = b.rows[i];
    ASSERT_EQ(x.handle.time, y.handle.time);
    ASSERT_EQ(x.handle.pose.position, y.handle.pose.position);
    ASSERT_EQ(x.handle.pose.orientation.coeffs(), y.handle.pose.orientation.coeffs());
    ASSERT_EQ(x.handle.buttons, y.handle.buttons);
    ASSERT_EQ(x.bur.position, y.bur.position);
    ASSERT_EQ(x.bur.orientation.coeffs(), y.bur.orientation.coeffs());
    ASSERT_EQ(x.bur_velocity, y.bur_velocity);
    ASSERT_EQ(x.grinding_force, y.grinding_force);
    ASSERT_EQ(x.device_force, y.device_force);
    ASSERT_EQ(x.torque, y.torque);
    ASSERT_EQ(x.torque_trial, y.torque_trial);
    ASSERT_DOUBLE_EQ(x.power, y.power);  // N.mm/s against W: a conversion rounds
    ASSERT_EQ(x.rotation_rate, y.rotation_rate);
    ASSERT_EQ(x.stalled, y.stalled);
    ASSERT_EQ(x.stalled_fraction, y.stalled_fraction);
    ASSERT_EQ(x.contact_area, y.contact_area);
    ASSERT_EQ(x.removed_volume, y.removed_volume);
    ASSERT_EQ(x.shank_contact_area, y.shank_contact_area);
  }
}

}  // namespace toothprep
