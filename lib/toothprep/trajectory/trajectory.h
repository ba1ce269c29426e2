// Commanded motions of the handle: scripts (.toml), recordings (.csv; .h5 is read by the trace room),
// and their resampling to the step rate.
#pragma once

#include <string>
#include <vector>

#include "toothprep/core/step_record.h"

namespace toothprep {

struct Trajectory {
  std::vector<HandleSample> samples;  // time strictly increasing
  std::vector<Vec3> measured_force;   // N, tooth on bur, W; empty or one per sample
};

// Reads `time_s,x_mm,y_mm,z_mm[,qx,qy,qz,qw][,buttons][,fx_N,fy_N,fz_N]`. Throws InputError with the
// line and column for anything else: wrong header, a missing unit, NaN, time that does not increase,
// a quaternion that is not of unit length (to 1e-3; it is normalised), fewer than two samples.
Trajectory read_csv_trajectory(const std::string& path);

// Runs a script (segments line, hold, arc, waypoints, lattice) at its rate_hz. Throws InputError with
// the key, e.g. "segment[3].speed_mm_s".
Trajectory read_script(const std::string& path);
Trajectory parse_script(const std::string& toml, const std::string& where);

// Samples at exactly start + i * time_step, i = 0, 1, ...: positions linear, orientations slerp, buttons
// of the latest sample. A trajectory that already has these times (to 1e-9 s) is returned bit for bit.
// A gap above 0.1 s is an InputError naming the time, unless `allow_gaps`.
std::vector<HandleSample> resample(const Trajectory& trajectory, double time_step, bool allow_gaps,
                                   const std::string& where);

}  // namespace toothprep
