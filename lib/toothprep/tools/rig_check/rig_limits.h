// What a rig is judged by: limits of figures, a table of devices, and the settings of the method.
// All of it stands in data/rig/limits.toml, each value with where it comes from, to be copied and
// changed.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace toothprep {

// Of one figure, in the figure's own unit (rig_report.h). At least one side is given.
struct RigLimit {
  std::optional<double> min, max;
  std::string why;  // where it comes from, or what goes wrong beyond it
};

// What theory needs to know of a device and the device doesn't report.
struct DeviceTraits {
  std::string name;
  std::vector<std::string> models;  // a model whose name holds one of these, in any case
  double apparent_mass = 0;         // m, N·s²/mm, > 0
  double damping = 0;               // b, N·s/mm, >= 0
  double friction = 0;              // f_c, N, >= 0
  double encoder_count = 0;         // D, mm, > 0; a measured one takes precedence
  int delay_ticks = 0;              // from the command to the motor, whole ticks
  std::string status, source;       // "assumed", "data sheet", "measured", ...; where
};

struct RigMethod {
  double late_periods = 1.5;            // a longer period counts as late
  double rest_window_s = 0.5;           // rest is looked for in windows of this length,
  double rest_drift_mm = 0.01;          // in which the means of the quarters stay this close,
  double rest_noise_mm = 0.1;           // the rms about a straight line is below this,
  double rest_force_n = 0.2;            // and the device doesn't push harder than this
  double hand_damping = 2e-3;           // b_h, N·s/mm, that a light grip adds
  double feed_speed_mm_s = 0.5;         // v of the counts' limit, if the bur wasn't in contact
  double thermal_window_s = 10;         // of the sliding rms force
  double thermal_time_constant_s = 10;  // of the motors' first-order model
  double settling_s = 0.5;              // of a level of a sweep, left out
  double vibration_rms_n = 0.05;        // above 20 Hz; what is below is called stable
  double vibration_factor = 1.5;        // and what is below this times the counts' own noise
  double exercise_speed_mm_s = 0.1;     // a damper moved more slowly than this shows nothing
};

struct RigLimits {
  RigMethod method;
  std::vector<DeviceTraits> devices;
  std::map<std::string, RigLimit> limits;  // by figure
};

// Throws InputError that names the key and the condition: unknown keys and figures (with the
// nearest known), limits without `why`, min above max, devices without source.
RigLimits read_rig_limits(const std::string& path);
RigLimits parse_rig_limits(const std::string& toml, const std::string& where);

// The first whose models fit; nullptr: none.
const DeviceTraits* find_device(const RigLimits& limits, const std::string& model);

}  // namespace toothprep
