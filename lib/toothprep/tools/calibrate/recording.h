// Recordings of a rig: the bur's motion and the force on it, read and judged before anything is
// fitted to them.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/calibrate/force_basis.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {

// What a file's numbers mean, where it can't say so itself.
struct ForceReading {
  double newton_per_unit = 1;   // 0.00980665 for gf, 0.001 for mN
  bool unit_stated = false;     // by the user: no guess by magnitude
  bool on_tooth = false;        // the force of the bur on the tooth: the sign is turned
  std::optional<double> range;  // N: samples beyond it (per axis) are left out, as saturated
};

// Whose motion is wanted of a file that may hold both: the bur's where it is there, or the handle's
// (of a coupled rig).
enum class RecordedPose { kBurOrHandle, kHandle };

struct MeasuredRecording {   // one file, in internal units
  std::string name;          // of the file
  Trajectory motion;         // measured_force in N, of the tooth on the bur
  std::vector<char> usable;  // per sample: inside the sensor's range
  // Where the file has them, a value per sample.
  std::vector<double> rotation_rate;  // rev/s
  std::vector<double> torque;         // N·mm
  std::vector<char> stalled;          // 0 or 1
  // Empty if the file doesn't say.
  std::string tooth_sha256, bur, parameters_toml;
};

// .h5: /time, /force/measured, /bur/position or /handle/position (and the orientation beside it),
// and where present /handle/buttons, /rotation_rate, /torque, /stalled. Or .csv: the header of
// read_csv_trajectory() and, where present, rotation_rate_rev_s, torque_mNm, stalled. Throws
// InputError as the readers do, for a file without measured force, and as check_recording().
MeasuredRecording read_recording(const std::string& path, const ForceReading& reading = {},
                                 RecordedPose pose = RecordedPose::kBurOrHandle);

// The same of a CSV's table only, unchecked.
[[nodiscard]] MeasuredRecording read_recording_csv(const std::string& path);

// Throws InputError that names the sample: as many forces as poses, all finite, not constant, not
// stuck at a limit (several samples in a row at exactly the largest or smallest value of an axis),
// and of a magnitude that newtons at a bur have: above 25 N in 5 % of the samples they are grams
// or millinewtons (published forces of dentists' hands: 0.1 to 4.9 N). Fills `usable`, and
// `stalled` where the motor is on but the recorded speed below 2 % of its median.
void check_recording(MeasuredRecording& recording, const ForceReading& reading = {});

// Throws InputError if the recording names another tooth than `tooth_sha256`.
void check_same_tooth(const MeasuredRecording& recording, const std::string& tooth_sha256,
                      const std::string& tooth_path);

// The motion at the step rate with the spindle beside it; samples between a stalled one and its
// neighbour count as stalled. With `speed`, the recorded speed too (if there is one).
[[nodiscard]] RecordedMotion motion_of(const MeasuredRecording& recording, double time_step,
                                       bool allow_gaps, bool speed);

// Measured force by the force that u/N of the published order makes along the same motion, both rms
// in contact: 1 within a factor of ten for newtons, whatever the tissue; see kPlausible... in the
// source. NaN if the motion touches nothing.
[[nodiscard]] double force_by_plausible(const MeasuredRecording& recording,
                                        const ForceBasis& basis);
// Throws InputError if that ratio says grams (102 times too much) or millinewtons (1000 times).
void check_unit_by_model(const MeasuredRecording& recording, const ForceBasis& basis,
                         const ForceReading& reading);

}  // namespace toothprep
