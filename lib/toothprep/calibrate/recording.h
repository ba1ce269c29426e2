// Recordings of a rig: the bur's motion and the force on it, read and judged before anything is
// fitted to them.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toothprep/core/step_record.h"
#include "toothprep/trajectory/trajectory.h"

namespace toothprep {

// What a file's numbers mean, where it can't say so itself.
struct ForceReading {
  double newton_per_unit = 1;   // 0.00980665 for gf, 0.001 for mN
  bool unit_stated = false;     // by the user: no guess by magnitude
  bool on_tooth = false;        // the force of the bur on the tooth: the sign is turned
  std::optional<double> range;  // N: samples beyond it (per axis) are left out, as saturated
};

struct MeasuredRecording {
  std::string name;
  Trajectory motion;         // of the bur; measured_force in N, of the tooth on the bur
  std::vector<char> usable;  // per sample: inside the sensor's range
  std::string tooth_sha256;  // empty if the file doesn't say
  std::string bur;           // likewise
};

// .h5 (a trace: /bur/position is the motion; another: /handle/position) or .csv. Throws InputError
// as the readers do, for a file without measured force, and as check_recording().
MeasuredRecording read_recording(const std::string& path, const ForceReading& reading = {});

// Throws InputError that names the sample: as many forces as poses, all finite, not constant, not
// stuck at a limit (several samples in a row at exactly the largest or smallest value of an axis),
// and of a magnitude that newtons at a bur have: above 25 N in 5 % of the samples they are grams
// or millinewtons (published forces of dentists' hands: 0.1 to 4.9 N). Fills `usable`.
void check_recording(MeasuredRecording& recording, const ForceReading& reading = {});

// Throws InputError if the recording names another tooth than `tooth_sha256`.
void check_same_tooth(const MeasuredRecording& recording, const std::string& tooth_sha256,
                      const std::string& tooth_path);

}  // namespace toothprep
