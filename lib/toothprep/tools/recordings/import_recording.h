// Recordings of other labs as trajectories: columns, units, orientations, frames, clocks and
// blemishes. What is recognised is said in notes; what is assumed, or looks odd, in warnings; what
// can't be known is asked for by an InputError that names the option.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/core/geometry.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {

enum class QuaternionOrder { kAsNamed, kXyzw, kWxyz };  // of the four columns, from left to right

struct ImportSettings {
  std::string columns;  // set_columns()
  // Where the file doesn't say so itself.
  std::optional<double> mm_per_unit, newton_per_unit, radian_per_unit, rate_hz;
  QuaternionOrder quaternion = QuaternionOrder::kAsNamed;
  // Three of xyz in the order of the turns; capitals: about the body's own axes, else about the
  // recording's fixed ones. Empty: roll, pitch, yaw by name ("xyz"), else asked for.
  std::string euler;
  Pose to_world;          // x_W = t + R x: takes the recording's frame to the tooth's
  Pose tracked_to_bur;    // the bur (tip, +z to the shank) in the frame of what was tracked
  bool in_world = false;  // of a simulator's file: not relative to the anatomy
  bool force_on_tooth = false;
  std::string force_file;               // a second table, with its own clock
  std::optional<double> force_delay_s;  // of its clock behind the motion's; none: found
  bool despike = false;
  bool keep_held = false;  // repeated poses as they are
  double smooth_s = 0;     // window of a local quadratic; 0: none
};

// Reads settings' poses: keys translation_mm [x, y, z], rotation_xyzw [x, y, z, w] or matrix (3 or 4
// rows of 4 numbers, metres never). Throws InputError for anything else.
[[nodiscard]] Pose read_rigid_transform(const std::string& path);

struct ColumnUse {  // what was made of a column
  std::string quantity, column, unit;
};

struct ImportFigures {
  double duration_s = 0, rate_hz = 0, largest_gap_s = 0, path_mm = 0, median_speed_mm_s = 0,
         largest_speed_mm_s = 0;
  Vec3 low = Vec3::Zero(), high = Vec3::Zero();  // mm, W
  std::size_t samples = 0, rows = 0, gaps = 0, spikes = 0, held = 0, missing = 0,
              repeated_times = 0;
  double position_step_mm = 0;  // to which positions are rounded; 0: none found
  std::optional<double> force_delay_s, force_delay_std_s, largest_force_n;
};

struct ImportedRecording {
  std::string kind;         // of the file
  Trajectory motion;        // time from 0; measured_force in N on the bur
  double first_time_s = 0;  // of the recording's clock, at time 0
  std::vector<double> rotation_rate, torque, stalled;  // a value per sample, or empty: rev/s, N·mm
  std::vector<ColumnUse> columns;
  ImportFigures figures;
  std::vector<std::string> notes, warnings;
};

// Throws InputError with file, line or option, and what to say.
[[nodiscard]] ImportedRecording import_recording(const std::string& path,
                                                 const ImportSettings& settings);

struct ImportSource {  // what the written file says of its origin
  std::string name, sha256, toothprep_version;
};

// Writes an HDF5 file with /time, /handle/position and so on (data/recordings/README.md), which
// replay and calibrate read. Throws Error if it can't be written.
void write_imported(const ImportedRecording& recording, const ImportSource& source,
                    const std::string& path);

}  // namespace toothprep
