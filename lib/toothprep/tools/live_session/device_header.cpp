#include "toothprep/tools/live_session/device_header.h"

#include <fmt/format.h>
#include <sys/utsname.h>
#include <unistd.h>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

std::string host_line(bool real_time) {
  utsname name{};
  uname(&name);
  return fmt::format("{} {} {}, {} processors; {}", name.sysname, name.release, name.machine,
                     sysconf(_SC_NPROCESSORS_ONLN),
                     real_time ? "real-time priority asked for" : "normal priority");
}

}  // namespace

void check_calibration(HapticDevice& device) {
  switch (device.calibration()) {
    case Calibration::kOk:
      return;
    case Calibration::kNeedsUpdate:
      throw Error(
          "the device is not calibrated; move its arm through the whole workspace, then try again");
    case Calibration::kNeedsManualInput:
      throw Error(
          "the device is not calibrated; put the stylus into its inkwell or rest, then try again");
  }
}

void describe_device(const HapticDevice& device, const ForceLimits& limits,
                     const ReadingLimits& readings, bool safety_switch, const LiveWatch& watch,
                     SessionHeader& header) {
  const DeviceIdentity& id = device.identity();
  const DeviceLimits& l = device.limits();
  header.device_name = id.name;
  header.device_model = id.model;
  header.device_vendor = id.vendor;
  header.device_driver = id.driver;
  header.device_serial = id.serial;
  header.device_firmware = id.firmware;
  if (device.mirror_identity()) header.mirror_model = device.mirror_identity()->model;
  header.rate_hz = l.rate;
  header.max_force_n = l.max_force;
  header.max_continuous_force_n = l.max_continuous_force;
  header.max_stiffness_n_per_mm = l.max_stiffness;
  header.max_damping_n_s_per_mm = l.max_damping;
  header.workspace_min = l.workspace.min();
  header.workspace_max = l.workspace.max();
  header.limit_notes = l.notes;
  header.force_limit_n = limits.max_force;
  header.force_rate_limit_n_per_s = limits.max_force_rate;
  header.safety = {limits.ramp,
                   limits.fade,
                   watch.stale,
                   readings.frozen_after,
                   limits.vibration_limit,
                   limits.vibration_time,
                   limits.thermal_time,
                   readings.speed};
  header.safety_switch = safety_switch ? "used" : "ignored";
  header.host = host_line(watch.real_time);
}

}  // namespace toothprep
