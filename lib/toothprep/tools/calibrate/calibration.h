// A calibration from recordings to fit: motions resampled and checked, the tool's own forces along
// them computed, u and alpha fitted, and what the recordings say beside (torque, droop, stalls)
// compared. The whole of `toothprep calibrate` between its options and its files.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "toothprep/step/session/plausibility.h"
#include "toothprep/tools/calibrate/coupled.h"
#include "toothprep/tools/calibrate/fit_files.h"
#include "toothprep/tools/calibrate/law_fit.h"

namespace toothprep {

struct CalibrationSettings {          // what the options of `toothprep calibrate` say
  Parameters parameters;              // time step, coupling, handpiece, where the search starts
  FitOptions fit;                     // what is estimated (fit.h)
  ForceReading force;                 // how the recorded force is meant (recording.h)
  bool coupled = false;               // the handle's motion was recorded, not the bur's
  bool rotation_rate_stated = false;  // parameters' rotation rate wins over a recorded speed
  bool fit_droop = false;             // of an imposed motion, from the recorded speed
  bool fit_droop_exponent = false;    // the droop with its exponent
  bool fit_rotor = false;             // the droop with the rotor's inertia and run-down time
  std::vector<LawKind> laws;          // to be fitted beside the paper's; of an imposed motion
  bool allow_gaps = false;            // interpolate gaps above 0.1 s in the motion
  double motion_window = 0;           // s, of a local quadratic through the motion; 0: none

  // Whether the droop is fitted, with or without exponent and rotor.
  [[nodiscard]] bool fits_droop() const { return fit_droop || fit_droop_exponent || fit_rotor; }
};

// What a caller may want to know while it runs; each may be empty.
struct CalibrationListener {
  std::function<void(const std::string&)> say, warn;  // a sentence each
  // What is implausible in the file that is named; may throw.
  std::function<void(const std::string& file, const std::vector<Finding>&)> judged;
  std::function<void(double)>
      motion;  // share of the motions that is done, from one thread at a time
};

// To be moved, not copied: the recordings refer to the bases.
struct CalibrationResult {
  CalibrationResult() = default;
  CalibrationResult(CalibrationResult&&) = default;             // bases keep their place
  CalibrationResult& operator=(CalibrationResult&&) = default;  // the same

  FitResult fit;                              // u, alpha and the rest, with their uncertainty
  std::vector<ComparedRecording> recordings;  // one per file, in their order
  Parameters parameters;              // the settings', at the rotation rate that the fit is for
  std::vector<ForceBasis> bases;      // of an imposed motion
  CoupledFit coupled;                 // of a handle's
  std::optional<LawComparison> laws;  // where they were asked for
};

// The files, each read and checked: a plausible motion, the same tooth as `tooth_sha256` (of the
// file `tooth`), the bur by name. Throws InputError as read_recording() does.
std::vector<MeasuredRecording> read_recordings(const std::vector<std::string>& files,
                                               const CalibrationSettings& settings,
                                               const std::string& tooth_sha256,
                                               const std::string& tooth, const std::string& bur,
                                               const CalibrationListener& listener = {});

// Throws Error for settings that contradict each other, before anything is read.
void check_settings(const CalibrationSettings& settings);

// Throws Error and InputError as fit(), fit_coupled() and resample() do.
CalibrationResult calibrate(const Bur& bur, const LayeredTooth& tooth,
                            const std::vector<MeasuredRecording>& recordings,
                            const CalibrationSettings& settings,
                            const CalibrationListener& listener = {});

// The result in lines of text: u and alpha per tissue with intervals, residuals, sensor, torque,
// droop, and whether constants suffice.
[[nodiscard]] std::vector<std::string> describe(const FitResult& fit);

}  // namespace toothprep
