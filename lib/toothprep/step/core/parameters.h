// The model's parameters, in the toolkit's own units (step/core/units.h). Presets: `paper` (Wu, Wang,
// Wang and Zhang, "Toward Stable and Realistic Haptic Interaction for Tooth Preparation
// Simulation"), `physical` (real turbine speed with linear droop; its specific energies are not
// calibrated) and `literature` (what published cutting tests support best).
#pragma once

#include <array>
#include <optional>
#include <string>

#include "toothprep/step/core/tissue.h"

namespace toothprep {

struct GrindingProperties {    // of a tissue: Eqs 6 to 9
  double specific_energy = 0;  // u, N/mm², >= 0
  double force_ratio = 0.25;   // alpha = F_t / F_n, > 0

  // Beyond the paper (step/grinding/grinding_law.h); as they stand here the law is the paper's.
  double size_exponent = 0;        // m: u (h/h0)^-m at the chip thickness h, -0.5 .. 0.9
  double ratio_exponent = 0;       // a: alpha (h/h0)^a; m + a is within -0.5 .. 0.9 as well
  double reference_chip = 0;       // h0, mm; > 0 where one of the others needs it
  double rubbing_pressure = 0;     // p, N/mm², >= 0: of tissue that the bur presses on, normal
  double rubbing_friction = 0.25;  // mu, >= 0: its tangential part
  double up_cutting = 0;           // g: u (1 + g c), c the cosine between rim and feed, |g| < 1

  bool operator==(const GrindingProperties&) const = default;  // all members
};

// Whether the force of an element is proportional to its advance: the paper's law.
[[nodiscard]] bool is_linear(const GrindingProperties& tissue);

enum class HandpieceModel {  // what the rotation rate does under load
  kFixed,                    // constant rotation rate, Boolean stall (Eq. 11)
  kDroop                     // T = stall_torque (1 - (N / N0)^droop_exponent)
};

enum class StallRule {  // which torque decides a stall
  kTrial,    // Eq. 11 on the torque of this step's trial velocity, before moving (default)
  kLastStep  // section 5.2 read literally: on the torque that the last step ended with
};

struct Handpiece {                                // what turns the bur: Eqs 10 and 11
  double rotation_rate = 100;                     // N (N0 for droop), rev/s, > 0
  double stall_torque = 1.2;                      // tau_s, N·mm, > 0; infinity = never stalls
  bool clockwise = true;                          // seen from the shank: omega along -z of B
  HandpieceModel model = HandpieceModel::kFixed;  // kFixed or kDroop
  StallRule stall_rule = StallRule::kTrial;       // kLastStep only with kFixed
  // Of kDroop: 1/2, 1, 3/2, ... 8. 1: torque and rotation rate on a line; more: the rate is held
  // longer under load. Halves only, so that no power from a mathematical library, which rounds
  // otherwise on another machine, is in a result.
  double droop_exponent = 1;
  // J of rotor and bur, t·mm² (N·mm·s²), >= 0; above 0 only with a finite stall torque and kTrial.
  // 0: the rate follows the torque at once. Free time constant with k = 1: 2 pi J N0 / tau_s.
  double rotor_inertia = 0;
  // s, >= 0, only with inertia: in which a free rotor stops from N0 after the motor was switched
  // off, evenly. 0: it is braked at once.
  double run_down = 0;
};

struct Coupling {          // between handle and bur: Eqs 12 to 18
  double stiffness = 1.0;  // k_VC, N/mm, > 0
  double damping = 0.0;    // b, N·s/mm, >= 0
  double bur_mass = 8e-6;  // m, N·s²/mm, > 0
  // Section 5.2, step 2, read literally: without contact the bur is put where the handle is.
  // Otherwise (default) it follows the handle through the same spring.
  bool attached_without_contact = false;
};

struct LoadDrive {        // of the drive `load` (step/session/load_step.h)
  double max_speed = 20;  // mm/s, > 0: of a bur that nothing holds
  // W: the bur slides along this direction alone, as on a sled, which bears all other forces.
  // Zero: it moves freely.
  std::array<double, 3> rail{};
};

enum class EngineKind { kLevelset, kVoxel };  // step/grinding/engine.h
enum class Drive {                            // what moves the bur
  kCoupled,                                   // it hangs on the handle by a spring
  kDirect,                                    // it follows the handle exactly
  kLoad                                       // a given force pushes it; the handle only turns it
};
[[nodiscard]] const char* name_of(EngineKind engine);  // "levelset", "voxel"
[[nodiscard]] const char* name_of(Drive drive);        // "coupled", "direct", "load"
[[nodiscard]] std::optional<Drive> drive_named(const std::string& name);  // none: no such drive

struct Parameters;
// The same of all tissues.
[[nodiscard]] bool is_linear(const Parameters& parameters);

struct Parameters {              // the whole model, constant during a session
  std::string preset = "paper";  // what the rest started from; a name, read for reports only
  PerTissue<GrindingProperties> tissue{};     // u is 0 here: start from a preset
  Handpiece handpiece;                        // rotation and stall
  Coupling coupling;                          // of the coupled drive
  LoadDrive load;                             // of the drive `load`
  double time_step = 1e-3;                    // h, s, > 0
  EngineKind engine = EngineKind::kLevelset;  // levelset, or the paper's voxels
  // Levelset engine: largest size of the pieces into which the border of the contact is divided,
  // mm, >= 0.005. 0: as the bur's size asks for (step/grinding/engine.h).
  double element_size = 0;
  bool trailing_elements = false;  // voxel engine: Eq. 8 literally, elements with v·n < 0 pull
  // On: v(s) = v + omega_H x r(s), so that removal and work agree while the handle turns.
  // Off: the paper's reading, one velocity for the whole bur.
  bool rotation_feed = true;
};

inline constexpr const char* kPresets[] = {"paper", "physical", "literature"};  // all of them
// The preset of that name; throws Error for another.
[[nodiscard]] Parameters preset_parameters(const std::string& name);

// Throws Error that names the first violated condition, with the name used in parameter files.
void validate(const Parameters& parameters);

// Parameters from a TOML file, or from its text (`where` then names it in errors). Absent keys come
// from the file's own `preset` or, failing that, `default_preset`; an unknown key is an InputError
// that names the nearest known one. The result is validated.
[[nodiscard]] Parameters read_parameters(const std::string& path,
                                         const std::string& default_preset = "paper");
[[nodiscard]] Parameters parse_parameters(const std::string& toml, const std::string& where,
                                          const std::string& default_preset = "paper");

// The same over `base` in place of a preset (unless the file names one itself).
[[nodiscard]] Parameters read_parameters(const std::string& path, const Parameters& base);
[[nodiscard]] Parameters parse_parameters(const std::string& toml, const std::string& where,
                                          const Parameters& base);

// The complete TOML text that parse_parameters turns into the same parameters, bit for bit. A
// unit's conversion rounds, and a few values are the conversion of no double: those are written in
// internal units (keys specific_energy_n_per_mm2, bur_mass_t), which readers take beside the usual
// keys.
[[nodiscard]] std::string to_toml(const Parameters& parameters);

}  // namespace toothprep
