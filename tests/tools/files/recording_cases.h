// Headers and ticks without a session behind them: every number is another one, so that a swapped
// column can't go unnoticed.
#pragma once

#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <string>

#include "toothprep/step/core/live_tick.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/tools/files/session_file.h"

namespace toothprep::testing {

constexpr double kStep = 1e-3;  // s

// A name of its own, and no file left behind.
struct ScratchFile {
  explicit ScratchFile(const std::string& name)
      : path(std::filesystem::temp_directory_path().string() + "/toothprep_" +
             std::to_string(getpid()) + "_" + name + ".h5") {
    std::remove(path.c_str());
  }
  ~ScratchFile() { std::remove(path.c_str()); }
  ScratchFile(const ScratchFile&) = delete;
  ScratchFile& operator=(const ScratchFile&) = delete;
  const std::string path;
};

inline SessionHeader synthetic_header(bool mirror = false) {
  SessionHeader h;
  h.trace.parameters_toml = to_toml(preset_parameters("paper"));
  h.trace.tooth_sha256 = std::string(64, 'b');
  h.trace.toothprep_version = "0.0.0";
  h.trace.bur = "ball:D1.2";
  h.trace.drive = "coupled";
  h.trace.engine = "levelset";
  h.trace.initial_overlap_mm3 = 0.0625;
  h.device_kind = "simulated";
  h.device_name = "default";
  h.device_model = "PHANTOM Desktop";
  h.device_vendor = "a vendor";
  h.device_driver = "libHD 3.4";
  h.device_serial = "S-1";
  h.device_firmware = "17";
  if (mirror) h.mirror_model = "Touch";
  h.rate_hz = 1000;
  h.max_force_n = 7.9;
  h.max_continuous_force_n = 1.75;
  h.max_stiffness_n_per_mm = 1.3;
  h.max_damping_n_s_per_mm = 0.002;
  h.workspace_min = Vec3(-80, -60, -35);
  h.workspace_max = Vec3(81, 61, 36);
  h.limit_notes = {"the rate was assumed", "\xc2\xb5 and so on"};
  h.force_limit_n = 3.5;
  h.force_rate_limit_n_per_s = 2000;
  h.safety = SafetyLimits{0.2, 0.05, 0.1, 0.25, 1.5, 0.06, 12, 1800};
  h.safety_switch = "used";
  h.registration = {Vec3(1, 2, 3), Quat(Eigen::AngleAxisd(0.7, Vec3(1, -2, 0.5).normalized()))};
  h.protocol = "rest";
  h.pedal = "1";
  h.host = "a machine, a kernel, SCHED_FIFO";
  return h;
}

inline LiveTick synthetic_tick(std::int64_t i, bool mirror = false) {
  const double x = static_cast<double>(i), wave = std::sin(0.37 * x);
  LiveTick t;
  StepRecord& r = t.row;
  r.handle.time = x * kStep;
  r.handle.pose.position = Vec3(0.01 * wave, 4 - 0.5 * x, 0.1 / (x + 1));
  r.handle.pose.orientation = Quat(Eigen::AngleAxisd(0.3 + 0.01 * x, Vec3(1, 2, 3).normalized()));
  r.handle.buttons = i % 97 ? 1u : 0x80000001u;
  r.handle.rejected = i % 11 == 10;
  r.bur.position = r.handle.pose.position + Vec3(0.05, wave, 0.02);
  r.bur.orientation = Quat(Eigen::AngleAxisd(0.2, Vec3(3, 1, 2).normalized()));
  r.bur_velocity = Vec3(0.001 * wave, -0.5, 1e-5 * x);
  r.grinding_force = Vec3(1.125, 4.5, 0.1) * wave;
  r.device_force = r.grinding_force + Vec3(0.02, 0.015, -0.01);
  r.torque = 0.8594 * wave;
  r.torque_trial = 0.9 * wave;
  r.rotation_rate = 100 + wave;
  r.power = 6.28 * x;
  r.stalled = i % 5 == 4;
  r.stalled_fraction = r.stalled ? 0.25 * (1 + i % 4) : 0;
  r.contact_area = {wave, 2 * wave, 3 * wave, 4 * wave};
  r.removed_volume = {x, 2 * x, 3 * x, 4 * x};
  r.shank_contact_area = 3e-3 * x;
  t.tick = i + 5'000'000'000;
  t.servo_time = 7 + x * 1.0001e-3;
  t.missed = i % 13 == 12 ? 2 : 0;
  t.device_position = Vec3(x, 2 * x, -x);
  t.device_orientation = Quat(Eigen::AngleAxisd(0.02 * x, Vec3(2, 1, 3).normalized()));
  t.device_buttons = static_cast<std::uint32_t>(i % 4);
  t.has_mirror = mirror;
  t.mirror_position = Vec3(-x, wave, 1);
  t.mirror_orientation = Quat(Eigen::AngleAxisd(-0.01 * x, Vec3(2, 1, 1).normalized()));
  t.mirror_buttons = static_cast<std::uint32_t>(i % 3);
  t.commanded_force = Vec3(wave, 0.5 * wave, 2);
  t.sent_force = Vec3(wave, 0.25 * wave, 3);
  t.force_scale = 0.5 + 0.5 * wave;
  t.flags = static_cast<std::uint32_t>(i % 128);
  t.fault = static_cast<std::uint32_t>(i % 7);
  t.step_seconds = 1e-6 * x;
  return t;
}

}  // namespace toothprep::testing
