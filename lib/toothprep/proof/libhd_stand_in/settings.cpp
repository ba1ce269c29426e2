#include "settings.h"

#include <cstdlib>
#include <map>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/strict_toml.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep::stand_in {
namespace {

using namespace hdapi;

const std::map<std::string, HDerror> kFaults = {
    {"warm-motors", HD_WARM_MOTORS},
    {"force-exceeded", HD_EXCEEDED_MAX_FORCE},
    {"impulse-exceeded", HD_EXCEEDED_MAX_FORCE_IMPULSE},
    {"velocity-exceeded", HD_EXCEEDED_MAX_VELOCITY},
    {"force-error", HD_FORCE_ERROR},
    {"device-fault", HD_DEVICE_FAULT},
    {"comm-error", HD_COMM_ERROR},
    {"timer-error", HD_TIMER_ERROR},
};
const std::map<std::string, FaultKind> kKinds = {
    {"unplugged", FaultKind::kUnplugged},
    {"pose-jump", FaultKind::kPoseJump},
    {"nan", FaultKind::kNan},
    {"frozen", FaultKind::kFrozen},
    {"lost-calibration", FaultKind::kLostCalibration},
    {"let-go", FaultKind::kLetGo},
    {"hanging-open", FaultKind::kHangingOpen},
    {"hanging-schedule", FaultKind::kHangingSchedule},
    {"hanging-start", FaultKind::kHangingStart},
    {"hanging-tick", FaultKind::kHangingTick},
    {"hanging-stop", FaultKind::kHangingStop},
};

template <class Value>
void take(std::optional<Value> given, Value& value) {
  if (given) value = *given;
}

template <class Value>
Value take_choice(StrictTable& table, const std::string& key,
                  const std::map<std::string, Value>& choices, Value otherwise) {
  std::vector<std::string> names;
  names.reserve(choices.size());
  for (const auto& [name, value] : choices) names.push_back(name);
  const std::optional<std::string> name = table.choice(key, names);
  return name ? choices.at(*name) : otherwise;
}

std::optional<long> take_count(StrictTable& table, const std::string& key, long lowest) {
  const std::optional<std::int64_t> value = table.integer(key);
  if (!value) return {};
  if (*value < lowest) table.refuse(key, "must be " + std::to_string(lowest) + " or more");
  return static_cast<long>(*value);
}

void apply_hand(StrictTable table, HandSettings& hand) {
  take(table.text("path"), hand.path);
  take(table.choice("motion", {"gentle", "rest"}), hand.motion);
  take(table.vector("center_mm"), hand.center.position);
  if (const auto q = table.numbers("orientation_xyzw")) {
    if (q->size() != 4 ||
        !accept_quaternion(Quat((*q)[3], (*q)[0], (*q)[1], (*q)[2]), hand.center.orientation))
      table.refuse("orientation_xyzw", "must be four numbers of a unit quaternion");
  }
  take(table.vector("amplitude_mm"), hand.amplitude);
  take(table.number("frequency_hz"), hand.frequency);
  if (const auto buttons = take_count(table, "buttons", 0))
    hand.buttons = static_cast<std::uint32_t>(*buttons);
  table.done();
}

void apply_disturbances(StrictTable table, Disturbances& d) {
  take(table.number("encoder_noise_mm"), d.encoder_noise);
  take(table.number("jitter_s"), d.jitter);
  take(take_count(table, "late_every", 0), d.late_every);
  take(table.number("late_s"), d.late);
  take(take_count(table, "missed_every", 0), d.missed_every);
  if (const auto seed = take_count(table, "seed", 0)) d.seed = static_cast<std::uint64_t>(*seed);
  table.done();
}

FaultSettings fault_of(StrictTable table) {
  FaultSettings fault;
  if (!table.has("what")) table.missing("what", "\"comm-error\"");
  std::vector<std::string> names;
  names.reserve(kKinds.size() + kFaults.size());
  for (const auto& [name, kind] : kKinds) names.push_back(name);
  for (const auto& [name, code] : kFaults) names.push_back(name);
  const std::string what = table.choice("what", names).value_or("");
  if (const auto kind = kKinds.find(what); kind != kKinds.end())
    fault.kind = kind->second;
  else
    fault.code = kFaults.at(what);
  take(table.vector("offset_mm"), fault.offset);
  take(take_count(table, "at_tick", 0), fault.at_tick);
  take(take_count(table, "ticks", 1), fault.ticks);
  if (const auto device = take_count(table, "device", 0))
    fault.device = static_cast<unsigned>(*device);
  table.done();
  return fault;
}

void apply(Settings& s, const std::string& toml, const std::string& where) {
  const toml::table parsed = parse_toml(toml, where);
  StrictTable table(parsed, where);
  if (const auto name = table.text("name")) s.names.front() = *name;
  if (const auto name = table.text("mirror_name")) s.names.back() = *name;
  take(table.text("model"), s.model);
  take(table.boolean("present"), s.present);
  take(table.boolean("stepped"), s.stepped);
  take(table.boolean("start_fails"), s.start_fails);
  take(table.boolean("has_orientation"), s.has_orientation);
  take(table.boolean("has_safety_switch"), s.has_safety_switch);
  take(table.boolean("rate_as_double"), s.rate_as_double);
  take(table.numbers("refused"), s.refused);
  s.calibration = take_choice<HDenum>(table, "calibration",
                                      {{"ok", HD_CALIBRATION_OK},
                                       {"needs-update", HD_CALIBRATION_NEEDS_UPDATE},
                                       {"needs-manual-input", HD_CALIBRATION_NEEDS_MANUAL_INPUT}},
                                      s.calibration);
  s.calibration_style = take_choice<HDenum>(table, "calibration_style",
                                            {{"auto", HD_CALIBRATION_AUTO},
                                             {"inkwell", HD_CALIBRATION_INKWELL},
                                             {"encoder-reset", HD_CALIBRATION_ENCODER_RESET}},
                                            s.calibration_style);
  take(table.number("max_force_n"), s.max_force);
  take(table.number("continuous_force_n"), s.continuous_force);
  take(table.number("max_stiffness_n_per_mm"), s.max_stiffness);
  take(table.number("max_damping_n_s_per_mm"), s.max_damping);
  take(table.number("motor_limit_n"), s.phantom.force_limit);
  take(table.number("rate_hz"), s.phantom.rate);
  take(table.number("encoder_count_mm"), s.phantom.encoder_count);
  take(table.number("friction_n"), s.phantom.friction);
  take(table.number("damping_n_s_per_mm"), s.phantom.damping);
  if (const auto grams = table.number("apparent_mass_g"))
    s.phantom.apparent_mass = units::from_gram(*grams);
  if (const auto delay = take_count(table, "delay_ticks", 0))
    s.phantom.delay_ticks = static_cast<int>(std::min<long>(*delay, 1000));
  if (const auto grams = table.number("hand_mass_g")) s.hand_model.mass = units::from_gram(*grams);
  take(table.number("hand_stiffness_n_per_mm"), s.hand_model.stiffness);
  take(table.number("hand_damping_n_s_per_mm"), s.hand_model.damping);
  if (const auto hand = table.table("hand")) apply_hand(*hand, s.hand);
  if (const auto mirror = table.table("mirror")) apply_hand(*mirror, s.mirror);
  if (const auto d = table.table("disturbances")) apply_disturbances(*d, s.disturbances);
  if (const auto faults = table.tables("fault")) {
    s.faults.clear();
    for (const StrictTable& fault : *faults) s.faults.push_back(fault_of(fault));
  }
  take(table.text("log"), s.log);
  take(take_count(table, "log_ticks", 1), s.log_ticks);
  table.done();
  validate(s.phantom);
  validate(s.hand_model);
  validate(s.disturbances);
}

Settings default_settings() {
  Settings s;
  s.mirror.center.position = Vec3(-40, 0, 0);
  s.mirror.amplitude = Vec3(-10, 5, 10);
  return s;
}

const char* environment(const char* name) {
  const char* const value = std::getenv(name);
  return value && *value ? value : nullptr;
}

}  // namespace

Settings parse_settings(const std::string& toml, const std::string& where) {
  Settings s = default_settings();
  apply(s, toml, where);
  return s;
}

Settings settings_of_environment() {
  Settings s = default_settings();
  if (const char* file = environment("TOOTHPREP_STANDIN")) apply(s, read_small_text(file), file);
  if (const char* toml = environment("TOOTHPREP_STANDIN_SET"))
    apply(s, toml, "TOOTHPREP_STANDIN_SET");
  if (const char* path = environment("TOOTHPREP_STANDIN_PATH")) s.hand.path = path;
  if (const char* path = environment("TOOTHPREP_STANDIN_MIRROR_PATH")) s.mirror.path = path;
  if (const char* path = environment("TOOTHPREP_STANDIN_LOG")) s.log = path;
  return s;
}

HandMotion motion_of(const HandSettings& hand) {
  HandMotion motion;
  if (!hand.path.empty())
    motion = hand_along(read_csv_trajectory(hand.path).samples);
  else if (hand.motion == "rest")
    motion = resting_hand(hand.center);
  else
    motion = gentle_hand(hand.center, hand.amplitude, hand.frequency);
  if (!hand.buttons) return motion;
  return [motion, buttons = *hand.buttons](double time) {
    DevicePose pose = motion(time);
    pose.buttons = buttons;
    return pose;
  };
}

}  // namespace toothprep::stand_in
