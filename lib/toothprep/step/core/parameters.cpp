#include "toothprep/step/core/parameters.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>

#include "toothprep/step/core/number_text.h"
#include "toothprep/step/core/strict_toml.h"
#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr double kSmallestElement = 0.005;  // mm; finer costs time and nothing is left to gain
constexpr double kSmallestExponent = 0.5, kLargestExponent = 8;  // of the droop
constexpr double kMostInertia = 1;                               // t·mm²: of a lathe
constexpr double kLongestRunDown = 1000;                         // s
constexpr double kSmallestSizeExponent = -0.5, kLargestSizeExponent = 0.9;
constexpr double kMostPressure = 1e5, kMostFriction = 100;  // N/mm², 1
constexpr double kThinnestChip = 1e-7;                      // mm: an atom
constexpr double kLargestTimeStep = 0.1;  // s; a haptic step is 1 ms, a tenth is a mistake

// Every key of a parameter file, dotted; used to guess what an unknown key was meant to be.
std::vector<std::string> all_keys() {
  std::vector<std::string> keys = {"preset",
                                   "handpiece.rotation_rate_rev_s",
                                   "handpiece.stall_torque_mnm",
                                   "handpiece.pressure_bar",
                                   "handpiece.stall_coefficient_mnm_per_bar",
                                   "handpiece.clockwise",
                                   "handpiece.model",
                                   "handpiece.droop_exponent",
                                   "handpiece.rotor_inertia_g_mm2",
                                   "handpiece.run_down_s",
                                   "handpiece.stall_judged_on",
                                   "coupling.stiffness_n_per_mm",
                                   "coupling.damping_n_s_per_mm",
                                   "coupling.bur_mass_g",
                                   "coupling.attached_without_contact",
                                   "load.max_speed_mm_s",
                                   "load.rail",
                                   "step.time_step_s",
                                   "step.rotation_feed",
                                   "engine.kind",
                                   "engine.element_mm",
                                   "engine.trailing_elements"};
  for (const auto name : kTissueNames)
    for (const char* key :
         {".specific_energy_j_per_mm3", ".force_ratio", ".size_exponent", ".ratio_exponent",
          ".reference_chip_um", ".rubbing_pressure_n_per_mm2", ".rubbing_friction", ".up_cutting"})
      keys.push_back("tissue." + std::string(name) + key);
  return keys;
}

// The shortest decimal that reads back as the same double, as TOML writes a float.
std::string toml_number(double value) {
  if (std::isinf(value)) return value > 0 ? "inf" : "-inf";
  if (std::isnan(value)) return "nan";
  std::string text = shortest_text(value);
  if (text.find_first_of(".e") == std::string::npos) text += ".0";
  return text;
}

// The x near `guess` for which from(x) == value exactly, if there is one: a conversion rounds, so
// its inverse may be off by some units in the last place, and some doubles are no conversion of
// anything.
template <class From>
std::optional<double> exact_inverse(double value, double guess, From from) {
  double up = guess, down = guess;
  for (int i = 0; i < 4; ++i) {
    if (from(up) == value) return up;
    if (from(down) == value) return down;
    up = std::nextafter(up, std::numeric_limits<double>::infinity());
    down = std::nextafter(down, -std::numeric_limits<double>::infinity());
  }
  return {};
}

bool is_preset(const std::string& name) {
  return std::find(std::begin(kPresets), std::end(kPresets), name) != std::end(kPresets);
}

// "paper", "physical", ...
std::string preset_list() {
  std::string list;
  for (const std::string name : kPresets) list += (list.empty() ? "\"" : ", \"") + name + "\"";
  return list;
}

struct Violation {
  std::string place, condition;
};

// Of what the law has beyond the paper's.
std::optional<Violation> first_violation(const GrindingProperties& t, const std::string& place) {
  const auto got = [](double value) { return ", got " + toml_number(value); };
  const auto exponent = [](double value) {
    return value >= kSmallestSizeExponent && value <= kLargestSizeExponent;
  };
  const std::string range =
      toml_number(kSmallestSizeExponent) + " to " + toml_number(kLargestSizeExponent);
  if (!exponent(t.size_exponent))
    return Violation{place + ".size_exponent", "must be from " + range + got(t.size_exponent)};
  if (!exponent(t.size_exponent + t.ratio_exponent))
    return Violation{place + ".ratio_exponent", "added to size_exponent must be from " + range +
                                                    got(t.size_exponent + t.ratio_exponent)};
  for (const auto& [key, value, most] :
       {std::tuple{".rubbing_pressure_n_per_mm2", t.rubbing_pressure, kMostPressure},
        {".rubbing_friction", t.rubbing_friction, kMostFriction}})
    if (!(value >= 0 && value <= most))
      return Violation{place + key, "must be from 0.0 to " + toml_number(most) + got(value)};
  if (t.reference_chip != 0 && !(t.reference_chip >= kThinnestChip && t.reference_chip <= 1))
    return Violation{place + ".reference_chip_um",
                     "must be from " + toml_number(units::to_micrometre(kThinnestChip)) +
                         " to 1000.0" + got(units::to_micrometre(t.reference_chip))};
  if (!(std::abs(t.up_cutting) < 1))
    return Violation{place + ".up_cutting", "must lie between -1 and 1" + got(t.up_cutting)};
  const char* needs = t.size_exponent != 0    ? "size_exponent"
                      : t.ratio_exponent != 0 ? "ratio_exponent"
                                              : "rubbing_pressure_n_per_mm2";
  if (t.reference_chip == 0 &&
      (t.size_exponent != 0 || t.ratio_exponent != 0 || t.rubbing_pressure > 0))
    return Violation{place + ".reference_chip_um",
                     std::string("is missing: ") + needs + " refers to this chip thickness"};
  return {};
}

std::optional<Violation> rotor_violation(const Handpiece& handpiece) {
  const std::string key = "handpiece.rotor_inertia_g_mm2";
  const double inertia = handpiece.rotor_inertia, run_down = handpiece.run_down;
  if (!(inertia >= 0 && inertia <= kMostInertia))
    return Violation{key, "must be from 0.0 to " + toml_number(units::to_gram(kMostInertia)) +
                              ", got " + toml_number(units::to_gram(inertia))};
  if (inertia > 0 && !std::isfinite(handpiece.stall_torque))
    return Violation{key, "needs a finite stall torque, which is what speeds the rotor up"};
  if (inertia > 0 && handpiece.stall_rule == StallRule::kLastStep)
    return Violation{key,
                     "needs stall_judged_on = \"trial\": a rotor stalls when its own torque "
                     "is used up as well"};
  if (!(run_down >= 0 && run_down <= kLongestRunDown))
    return Violation{"handpiece.run_down_s", "must be from 0.0 to " + toml_number(kLongestRunDown) +
                                                 ", got " + toml_number(run_down)};
  if (run_down > 0 && inertia == 0)
    return Violation{"handpiece.run_down_s", "needs a rotor_inertia_g_mm2 above 0"};
  return {};
}

std::optional<Violation> first_violation(const Parameters& p) {
  const auto got = [](double value) { return ", got " + toml_number(value); };
  const auto positive = [&](double value, const std::string& place) -> std::optional<Violation> {
    if (value > 0 && std::isfinite(value)) return {};
    return Violation{place, "must be positive and finite" + got(value)};
  };
  const auto not_negative = [&](double value,
                                const std::string& place) -> std::optional<Violation> {
    if (value >= 0 && std::isfinite(value)) return {};
    return Violation{place, "must be finite and not negative" + got(value)};
  };
  if (!is_preset(p.preset))
    return Violation{"preset", "\"" + p.preset + "\" is none of " + preset_list()};
  for (int k = 0; k < kTissueCount; ++k) {
    const std::string place = "tissue." + std::string(kTissueNames[k]);
    if (auto v = not_negative(p.tissue[k].specific_energy, place + ".specific_energy_j_per_mm3"))
      return v;
    if (auto v = positive(p.tissue[k].force_ratio, place + ".force_ratio")) return v;
    if (auto v = first_violation(p.tissue[k], place)) return v;
  }
  if (auto v = positive(p.handpiece.rotation_rate, "handpiece.rotation_rate_rev_s")) return v;
  if (!(p.handpiece.stall_torque > 0))  // infinity is allowed: never stalls
    return Violation{"handpiece.stall_torque_mnm",
                     "must be positive (inf: never stalls)" + got(p.handpiece.stall_torque)};
  if (p.handpiece.stall_rule == StallRule::kLastStep && p.handpiece.model != HandpieceModel::kFixed)
    return Violation{"handpiece.stall_judged_on",
                     "\"last_step\" needs model = \"fixed\": the droop model has no torque of its "
                     "own to judge"};
  const double exponent = p.handpiece.droop_exponent;
  if (!(exponent >= kSmallestExponent && exponent <= kLargestExponent) ||
      2 * exponent != std::floor(2 * exponent))
    return Violation{"handpiece.droop_exponent", "must be 0.5, 1, 1.5, ... or 8" + got(exponent)};
  if (auto v = rotor_violation(p.handpiece)) return v;
  if (p.element_size != 0 && !(p.element_size >= kSmallestElement && std::isfinite(p.element_size)))
    return Violation{"engine.element_mm", "must be at least " + toml_number(kSmallestElement) +
                                              " mm, or 0 for the size that suits the bur" +
                                              got(p.element_size)};
  if (p.trailing_elements && p.engine != EngineKind::kVoxel)
    return Violation{"engine.trailing_elements", "needs kind = \"voxel\""};
  if (p.trailing_elements && !is_linear(p))
    return Violation{"engine.trailing_elements",
                     "needs the paper's law: an element that moves away has no chip"};
  if (auto v = positive(p.coupling.stiffness, "coupling.stiffness_n_per_mm")) return v;
  if (auto v = not_negative(p.coupling.damping, "coupling.damping_n_s_per_mm")) return v;
  if (auto v = positive(p.coupling.bur_mass, "coupling.bur_mass_g")) return v;
  if (auto v = positive(p.load.max_speed, "load.max_speed_mm_s")) return v;
  for (const double x : p.load.rail)
    if (!std::isfinite(x)) return Violation{"load.rail", "must be finite" + got(x)};
  if (auto v = positive(p.time_step, "step.time_step_s")) return v;
  if (p.time_step > kLargestTimeStep)
    return Violation{"step.time_step_s",
                     "must be at most " + toml_number(kLargestTimeStep) + " s" + got(p.time_step)};
  return {};
}

// What the law has beyond the paper's: programs before 0.2 don't know it.
std::string law_toml(const GrindingProperties& t) {
  std::string text;
  const GrindingProperties paper;
  const auto put = [&](const char* key, double value, double usual) {
    if (value != usual) text += std::string(key) + " = " + toml_number(value) + "\n";
  };
  put("size_exponent", t.size_exponent, paper.size_exponent);
  put("ratio_exponent", t.ratio_exponent, paper.ratio_exponent);
  if (const auto x = exact_inverse(t.reference_chip, units::to_micrometre(t.reference_chip),
                                   units::from_micrometre))
    put("reference_chip_um", *x, paper.reference_chip);
  else
    put("reference_chip_mm", t.reference_chip, paper.reference_chip);
  put("rubbing_pressure_n_per_mm2", t.rubbing_pressure, paper.rubbing_pressure);
  put("rubbing_friction", t.rubbing_friction, paper.rubbing_friction);
  put("up_cutting", t.up_cutting, paper.up_cutting);
  return text;
}

// Reads `key` in the file's unit, or `direct_key` in the internal one. The second exists for values
// that no number in the file's unit converts to exactly (see to_toml).
template <class From>
void read_either(StrictTable& table, const std::string& key, const std::string& direct_key,
                 From from, double& value) {
  if (table.has(key) && table.has(direct_key))
    table.refuse(direct_key, "stands beside " + key, "give one of them");
  if (const auto x = table.number(key)) value = from(*x);
  if (const auto x = table.number(direct_key)) value = *x;
}

void read_law(StrictTable& table, GrindingProperties& tissue) {
  if (const auto x = table.number("force_ratio")) tissue.force_ratio = *x;
  if (const auto x = table.number("size_exponent")) tissue.size_exponent = *x;
  if (const auto x = table.number("ratio_exponent")) tissue.ratio_exponent = *x;
  if (const auto x = table.number("rubbing_pressure_n_per_mm2")) tissue.rubbing_pressure = *x;
  if (const auto x = table.number("rubbing_friction")) tissue.rubbing_friction = *x;
  if (const auto x = table.number("up_cutting")) tissue.up_cutting = *x;
  read_either(table, "reference_chip_um", "reference_chip_mm", units::from_micrometre,
              tissue.reference_chip);
}

void read_handpiece(StrictTable& table, Handpiece& handpiece) {
  if (const auto x = table.number("rotation_rate_rev_s")) handpiece.rotation_rate = *x;
  const auto torque = table.number("stall_torque_mnm");
  const auto pressure = table.number("pressure_bar");
  const auto coefficient = table.number("stall_coefficient_mnm_per_bar");
  if (torque && (pressure || coefficient))
    table.refuse("stall_torque_mnm",
                 std::string("stands beside ") +
                     (pressure ? "pressure_bar" : "stall_coefficient_mnm_per_bar"),
                 "give the stall torque, or pressure_bar and stall_coefficient_mnm_per_bar");
  if (pressure.has_value() != coefficient.has_value())
    table.refuse(pressure ? "stall_coefficient_mnm_per_bar" : "pressure_bar",
                 std::string("is missing beside ") +
                     (pressure ? "pressure_bar" : "stall_coefficient_mnm_per_bar"),
                 "the stall torque is their product");
  for (const auto& [key, value] :
       {std::pair{"pressure_bar", pressure}, {"stall_coefficient_mnm_per_bar", coefficient}})
    if (value && !(*value > 0 && std::isfinite(*value)))
      table.refuse(key, "must be positive and finite, got " + toml_number(*value));
  if (torque) handpiece.stall_torque = *torque;
  if (pressure) handpiece.stall_torque = *coefficient * *pressure;  // Eq. 10
  if (const auto x = table.boolean("clockwise")) handpiece.clockwise = *x;
  if (const auto x = table.choice("model", {"fixed", "droop"}))
    handpiece.model = *x == "droop" ? HandpieceModel::kDroop : HandpieceModel::kFixed;
  if (const auto x = table.number("droop_exponent")) handpiece.droop_exponent = *x;
  read_either(table, "rotor_inertia_g_mm2", "rotor_inertia_t_mm2", units::from_gram,
              handpiece.rotor_inertia);
  if (const auto x = table.number("run_down_s")) handpiece.run_down = *x;
  if (const auto x = table.choice("stall_judged_on", {"trial", "last_step"}))
    handpiece.stall_rule = *x == "trial" ? StallRule::kTrial : StallRule::kLastStep;
}

}  // namespace

bool is_linear(const GrindingProperties& t) {
  return t.size_exponent == 0 && t.ratio_exponent == 0 && t.rubbing_pressure == 0 &&
         t.up_cutting == 0;
}

bool is_linear(const Parameters& parameters) {
  return std::all_of(parameters.tissue.begin(), parameters.tissue.end(),
                     [](const GrindingProperties& t) { return is_linear(t); });
}

const char* name_of(EngineKind engine) {
  return engine == EngineKind::kVoxel ? "voxel" : "levelset";
}

const char* name_of(Drive drive) {
  switch (drive) {
    case Drive::kCoupled:
      return "coupled";
    case Drive::kDirect:
      return "direct";
    case Drive::kLoad:
      return "load";
  }
  return "";
}

std::optional<Drive> drive_named(const std::string& name) {
  for (const Drive drive : {Drive::kCoupled, Drive::kDirect, Drive::kLoad})
    if (name == name_of(drive)) return drive;
  return {};
}

Parameters preset_parameters(const std::string& name) {
  double alpha = 0.25;
  const auto tissue = [&alpha](double u_joule_per_mm3) {
    return GrindingProperties{units::from_joule_per_mm3(u_joule_per_mm3), alpha};
  };
  Parameters p;
  p.preset = name;
  if (name == "paper") {
    p.tissue = {tissue(0.3), tissue(0.1), tissue(0.01), tissue(0.1)};
  } else if (name == "physical") {
    // Enamel is what makes the 4 N·s/mm quoted for a 1.2 mm x 3 mm cylinder at 5000 rev/s, dentin a
    // third of it. Nobody has measured pulp or other: in proportion to `paper`. None is calibrated.
    p.tissue = {tissue(6.7), tissue(2.2), tissue(0.22), tissue(2.2)};
    p.handpiece.rotation_rate = 5000;
    p.handpiece.stall_torque = 1.0;
    p.handpiece.model = HandpieceModel::kDroop;
  } else if (name == "literature") {
    // For gross cutting with a turbine; where each number comes from: data/parameters/README.md.
    alpha = 0.45;
    p.tissue = {tissue(5.4), tissue(2.1), tissue(0.21), tissue(2.1)};
    p.handpiece.rotation_rate = 5000;
    p.handpiece.stall_torque = 1.0;
    p.handpiece.model = HandpieceModel::kDroop;
  } else {
    throw Error("preset \"" + name + "\" is not known; use one of " + preset_list());
  }
  return p;
}

void validate(const Parameters& parameters) {
  if (const auto v = first_violation(parameters)) throw Error(v->place + ": " + v->condition);
}

Parameters parse_parameters(const std::string& toml, const std::string& where,
                            const Parameters& base) {
  const toml::table document = parse_toml(toml, where);
  const std::vector<std::string> keys = all_keys();
  StrictTable root(document, where);
  const auto preset = root.choice("preset", {std::begin(kPresets), std::end(kPresets)});
  Parameters p = preset ? preset_parameters(*preset) : base;
  if (auto tissues = root.table("tissue")) {
    for (int k = 0; k < kTissueCount; ++k)
      if (auto tissue = tissues->table(std::string(kTissueNames[k]))) {
        read_either(*tissue, "specific_energy_j_per_mm3", "specific_energy_n_per_mm2",
                    units::from_joule_per_mm3, p.tissue[k].specific_energy);
        read_law(*tissue, p.tissue[k]);
        tissue->done(keys);
      }
    tissues->done(keys);
  }
  if (auto handpiece = root.table("handpiece")) {
    read_handpiece(*handpiece, p.handpiece);
    handpiece->done(keys);
  }
  if (auto coupling = root.table("coupling")) {
    if (const auto x = coupling->number("stiffness_n_per_mm")) p.coupling.stiffness = *x;
    if (const auto x = coupling->number("damping_n_s_per_mm")) p.coupling.damping = *x;
    read_either(*coupling, "bur_mass_g", "bur_mass_t", units::from_gram, p.coupling.bur_mass);
    if (const auto x = coupling->boolean("attached_without_contact"))
      p.coupling.attached_without_contact = *x;
    coupling->done(keys);
  }
  if (auto load = root.table("load")) {
    if (const auto x = load->number("max_speed_mm_s")) p.load.max_speed = *x;
    if (const auto x = load->vector("rail")) {
      if (x->isZero(0)) load->refuse("rail", "has no direction", "leave it out for a free bur");
      p.load.rail = {x->x(), x->y(), x->z()};
    }
    load->done(keys);
  }
  if (auto step = root.table("step")) {
    if (const auto x = step->number("time_step_s")) p.time_step = *x;
    if (const auto x = step->boolean("rotation_feed")) p.rotation_feed = *x;
    step->done(keys);
  }
  if (auto engine = root.table("engine")) {
    if (const auto x = engine->choice("kind", {"levelset", "voxel"}))
      p.engine = *x == "voxel" ? EngineKind::kVoxel : EngineKind::kLevelset;
    if (const auto x = engine->number("element_mm")) p.element_size = *x;
    if (const auto x = engine->boolean("trailing_elements")) p.trailing_elements = *x;
    engine->done(keys);
  }
  root.done(keys);
  if (const auto v = first_violation(p)) throw InputError(where, v->place, v->condition);
  return p;
}

Parameters parse_parameters(const std::string& toml, const std::string& where,
                            const std::string& default_preset) {
  return parse_parameters(toml, where, preset_parameters(default_preset));
}

Parameters read_parameters(const std::string& path, const std::string& default_preset) {
  return parse_parameters(read_small_text(path), path, default_preset);
}

Parameters read_parameters(const std::string& path, const Parameters& base) {
  return parse_parameters(read_small_text(path), path, base);
}

std::string to_toml(const Parameters& p) {
  const auto flag = [](bool on) { return std::string(on ? "true" : "false"); };
  std::string text;
  if (p.preset == "literature")
    text +=
        "# from published cutting tests, mostly of other materials and read as abstracts; not "
        "calibrated\n";
  if (p.preset == "physical")
    text +=
        "# uncalibrated: the specific energies of this preset are estimates, not a calibration\n";
  text += "preset = \"" + p.preset + "\"\n";
  for (int k = 0; k < kTissueCount; ++k) {
    const double u = p.tissue[k].specific_energy;
    text += "\n[tissue." + std::string(kTissueNames[k]) + "]\n";
    if (const auto x = exact_inverse(u, units::to_joule_per_mm3(u), units::from_joule_per_mm3))
      text += "specific_energy_j_per_mm3 = " + toml_number(*x) + "\n";
    else  // no double in J/mm³ converts to these very bits
      text += "specific_energy_n_per_mm2 = " + toml_number(u) + "\n";
    text += "force_ratio = " + toml_number(p.tissue[k].force_ratio) + "\n";
    text += law_toml(p.tissue[k]);
  }
  const Handpiece& handpiece = p.handpiece;
  text += "\n[handpiece]\nrotation_rate_rev_s = " + toml_number(handpiece.rotation_rate) +
          "\nstall_torque_mnm = " + toml_number(handpiece.stall_torque) +
          "\nclockwise = " + flag(handpiece.clockwise) + "\nmodel = \"" +
          (handpiece.model == HandpieceModel::kDroop ? "droop" : "fixed") +
          "\"\nstall_judged_on = \"" +
          (handpiece.stall_rule == StallRule::kTrial ? "trial" : "last_step") + "\"\n";
  if (handpiece.droop_exponent != 1)  // programs before 0.2 don't know it
    text += "droop_exponent = " + toml_number(handpiece.droop_exponent) + "\n";
  const double inertia = handpiece.rotor_inertia;
  if (const auto x = exact_inverse(inertia, units::to_gram(inertia), units::from_gram)) {
    if (inertia != 0) text += "rotor_inertia_g_mm2 = " + toml_number(*x) + "\n";
  } else {
    text += "rotor_inertia_t_mm2 = " + toml_number(inertia) + "\n";
  }
  if (handpiece.run_down != 0) text += "run_down_s = " + toml_number(handpiece.run_down) + "\n";
  text += "\n[coupling]\nstiffness_n_per_mm = " + toml_number(p.coupling.stiffness) +
          "\ndamping_n_s_per_mm = " + toml_number(p.coupling.damping) + "\n";
  const double mass = p.coupling.bur_mass;
  if (const auto x = exact_inverse(mass, units::to_gram(mass), units::from_gram))
    text += "bur_mass_g = " + toml_number(*x) + "\n";
  else
    text += "bur_mass_t = " + toml_number(mass) + "\n";
  text += "attached_without_contact = " + flag(p.coupling.attached_without_contact) + "\n";
  text += "\n[load]\nmax_speed_mm_s = " + toml_number(p.load.max_speed) + "\n";
  const auto& rail = p.load.rail;
  if (rail != LoadDrive().rail)
    text += "rail = [" + toml_number(rail[0]) + ", " + toml_number(rail[1]) + ", " +
            toml_number(rail[2]) + "]\n";
  text += "\n[step]\ntime_step_s = " + toml_number(p.time_step) +
          "\nrotation_feed = " + flag(p.rotation_feed) + "\n";
  text += std::string("\n[engine]\nkind = \"") + name_of(p.engine) + "\"\n" +
          (p.element_size > 0 ? "element_mm = " + toml_number(p.element_size) + "\n" : "") +
          "trailing_elements = " + flag(p.trailing_elements) + "\n";
  return text;
}

}  // namespace toothprep
