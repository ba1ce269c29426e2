#include "toothprep/tools/rig_check/rig_limits.h"

#include <algorithm>
#include <cctype>

#include "toothprep/step/core/strict_toml.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/rig_check/rig_report.h"

namespace toothprep {
namespace {

std::string lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

// A required number in (0, most], or [0, most] with `zero`.
double positive(StrictTable& table, const std::string& key, double most, const std::string& example,
                bool zero = false) {
  const std::optional<double> value = table.number(key);
  if (!value) table.missing(key, example);
  if (!(std::isfinite(*value) && (*value > 0 || (zero && *value == 0)) && *value <= most))
    table.refuse(key, std::string("must be ") + (zero ? "0 or more" : "above 0") + " and at most " +
                          std::to_string(static_cast<long>(most)));
  return *value;
}

std::string words(StrictTable& table, const std::string& key, const std::string& example) {
  const std::optional<std::string> value = table.text(key);
  if (!value) table.missing(key, "\"" + example + "\"");
  if (value->empty()) table.refuse(key, "must not be empty");
  return *value;
}

RigMethod read_method(StrictTable table) {
  RigMethod m;
  m.late_periods = positive(table, "late_periods", 100, "1.5");
  m.rest_window_s = positive(table, "rest_window_s", 60, "0.5");
  m.rest_drift_mm = positive(table, "rest_drift_mm", 100, "0.05");
  m.rest_noise_mm = positive(table, "rest_noise_mm", 100, "0.1");
  m.rest_force_n = positive(table, "rest_force_n", 100, "0.2");
  m.hand_damping = positive(table, "hand_damping_n_s_per_m", 1000, "2.0", true) * 1e-3;
  m.feed_speed_mm_s = positive(table, "feed_speed_mm_s", 1000, "0.5");
  m.thermal_window_s = positive(table, "thermal_window_s", 3600, "10.0");
  m.thermal_time_constant_s = positive(table, "thermal_time_constant_s", 3600, "10.0");
  m.settling_s = positive(table, "settling_s", 60, "0.5", true);
  m.vibration_rms_n = positive(table, "vibration_rms_n", 100, "0.05");
  m.vibration_factor = positive(table, "vibration_factor", 100, "1.5");
  m.exercise_speed_mm_s = positive(table, "exercise_speed_mm_s", 1000, "0.1");
  table.done();
  return m;
}

DeviceTraits read_device(StrictTable& table) {
  DeviceTraits d;
  d.name = words(table, "name", "Phantom Desktop");
  const std::string models = words(table, "models", "PHANTOM Desktop, Phantom Desktop");
  for (std::size_t begin = 0; begin <= models.size();) {
    const std::size_t end = std::min(models.find(',', begin), models.size());
    std::string model = models.substr(begin, end - begin);
    model.erase(0, model.find_first_not_of(' '));
    model.erase(model.find_last_not_of(' ') + 1);
    if (model.empty()) table.refuse("models", "must be names with commas between");
    d.models.push_back(model);
    begin = end + 1;
  }
  d.apparent_mass = units::from_gram(positive(table, "apparent_mass_g", 100000, "45.0"));
  d.damping = positive(table, "damping_n_s_per_m", 1000, "0.05", true) * 1e-3;
  d.friction = positive(table, "friction_n", 100, "0.06", true);
  d.encoder_count = positive(table, "encoder_count_mm", 10, "0.023");
  const std::optional<std::int64_t> delay = table.integer("delay_ticks");
  if (!delay) table.missing("delay_ticks", "0");
  if (*delay < 0 || *delay > 100) table.refuse("delay_ticks", "must be 0 to 100");
  d.delay_ticks = static_cast<int>(*delay);
  d.status = words(table, "status", "measured here");
  d.source = words(table, "source", "own identification, 3 March");
  table.done();
  return d;
}

}  // namespace

RigLimits parse_rig_limits(const std::string& text, const std::string& where) {
  const toml::table root_table = parse_toml(text, where);
  StrictTable root(root_table, where);
  RigLimits result;
  if (std::optional<StrictTable> method = root.table("method"))
    result.method = read_method(*method);
  else
    throw InputError(where, "method", "is missing", "copy it from data/rig/limits.toml");
  if (std::optional<std::vector<StrictTable>> devices = root.tables("device"))
    for (StrictTable& device : *devices) result.devices.push_back(read_device(device));
  std::optional<StrictTable> limits = root.table("limits");
  if (!limits) throw InputError(where, "limits", "is missing", "copy it from data/rig/limits.toml");
  for (const RigFigure& figure : rig_catalogue()) {
    std::optional<StrictTable> table = limits->table(figure.key);
    if (!table) continue;
    RigLimit limit;
    limit.min = table->number("min");
    limit.max = table->number("max");
    if (!limit.min && !limit.max) table->missing("max", "1.0 (or min)");
    for (const auto& [key, side] : {std::pair("min", limit.min), std::pair("max", limit.max)})
      if (side && !std::isfinite(*side)) table->refuse(key, "must be finite");
    if (limit.min && limit.max && *limit.min > *limit.max)
      table->refuse("min", "must not be above max");
    limit.why = words(*table, "why", "where it comes from");
    table->done();
    result.limits[figure.key] = limit;
  }
  limits->done();
  root.done();
  return result;
}

RigLimits read_rig_limits(const std::string& path) {
  return parse_rig_limits(read_small_text(path), path);
}

const DeviceTraits* find_device(const RigLimits& limits, const std::string& model) {
  const std::string wanted = lower(model);
  for (const DeviceTraits& device : limits.devices)
    for (const std::string& name : device.models)
      if (wanted.find(lower(name)) != std::string::npos) return &device;
  return nullptr;
}

}  // namespace toothprep
