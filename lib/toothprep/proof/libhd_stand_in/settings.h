// What the stand-in pretends to be. Format and meaning of the keys: README.md.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/device/disturbances.h"
#include "toothprep/tools/device/hand_motion.h"
#include "toothprep/tools/device/hdapi.h"
#include "toothprep/tools/device/simulated_phantom.h"

namespace toothprep::stand_in {

struct HandSettings {
  std::string path;  // CSV; empty: `motion`
  std::string motion = "gentle";
  DevicePose center;
  Vec3 amplitude = Vec3(10, 5, 10);      // mm
  double frequency = 0.25;               // Hz
  std::optional<std::uint32_t> buttons;  // over those of the path
};

enum class FaultKind {
  kError,            // the driver reports `code`
  kUnplugged,        //
  kPoseJump,         // the position is read `offset` aside
  kNan,              // the position is read as NaN
  kFrozen,           // the pose is read as it was when this began
  kLostCalibration,  // hdCheckCalibration says so
  kHangingTick,      // a call in the servo's tick takes so many periods
  kLetGo,            // the safety switch is read as open
  kHangingOpen,      // hdInitDevice never returns
  kHangingSchedule,  // nor hdScheduleAsynchronous
  kHangingStart,     // nor hdStartScheduler, although the servo runs
  kHangingStop       // nor hdStopScheduler
};

struct FaultSettings {
  long at_tick = 0, ticks = 1;
  FaultKind kind = FaultKind::kError;
  hdapi::HDerror code = 0;
  unsigned device = 0;
  Vec3 offset = Vec3(20, 0, 0);  // mm, D
};

struct Settings {
  std::vector<std::string> names = {"default", "mirror"};
  std::string model = "PHANTOM Desktop";
  bool present = true, stepped = false, start_fails = false;
  bool has_orientation = true, has_safety_switch = true, rate_as_double = false;
  std::vector<double> refused;  // parameters
  hdapi::HDenum calibration = hdapi::HD_CALIBRATION_OK;
  hdapi::HDenum calibration_style = hdapi::HD_CALIBRATION_AUTO;
  double max_force = 7.9, continuous_force = 1.75;  // N, as reported
  double max_stiffness = 1.0, max_damping = 5e-3;   // N/mm, N·s/mm, as reported
  PhantomModel phantom;
  HandModel hand_model;
  Disturbances disturbances;
  HandSettings hand, mirror;
  std::vector<FaultSettings> faults;
  std::string log;         // a file; empty: none
  long log_ticks = 20000;  // most rows of it
};

// Over the defaults. Throws Error (InputError) for what isn't acceptable.
Settings parse_settings(const std::string& toml, const std::string& where);

// The defaults, then the file that $TOOTHPREP_STANDIN names, then the TOML text in
// $TOOTHPREP_STANDIN_SET, then the paths in $TOOTHPREP_STANDIN_PATH,
// $TOOTHPREP_STANDIN_MIRROR_PATH and $TOOTHPREP_STANDIN_LOG.
Settings settings_of_environment();

// Reads the path, if there is one.
HandMotion motion_of(const HandSettings& hand);

}  // namespace toothprep::stand_in
