// Commanded motions of the handle: scripts (.toml), recordings (.csv; .h5 is read by the trace
// module), and their resampling to the step rate.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "toothprep/step/core/step_record.h"

namespace toothprep {

// More samples than this (5.5 hours at 1 kHz) are refused by every reader: a mistake in a rate or a
// clock, not a preparation, and a trace of them would not fit into memory.
constexpr std::size_t kMostSamples = 20'000'000;

struct Trajectory {
  std::vector<HandleSample> samples;  // time strictly increasing
  std::vector<Vec3> measured_force;   // N, tooth on bur, W; empty or one per sample
};

// Takes a recorded quaternion as an orientation: false unless its length is 1 to 1e-3. It is
// normalised only where it needs to be, so that what this toolkit wrote is read back bit for bit.
bool accept_quaternion(const Quat& recorded, Quat& orientation);

// Reads `time_s,x_mm,y_mm,z_mm[,qx,qy,qz,qw][,buttons][,fx_N,fy_N,fz_N]`. Throws InputError with
// the line and column for anything else: wrong header, a missing unit, NaN, time that does not
// increase, a quaternion that is not of unit length (to 1e-3; it is normalised), fewer than two
// samples. Columns are found by name, so their order is free.
Trajectory read_csv_trajectory(const std::string& path);
// The same of a table that may have further columns, named in `also`: those that it has go to
// `further` by their name, a finite value per sample.
Trajectory read_csv_trajectory(const std::string& path, const std::vector<std::string>& also,
                               std::map<std::string, std::vector<double>>& further);

// Runs a trajectory script (.toml): `start_mm`, `axis` (tip to shank, default +z), `spin_deg`,
// `rate_hz` (default 1000), then [[segment]] tables in order, each with a `kind`:
//   line       to_mm; speed_mm_s, or acceleration_mm_s2 (from rest, or from speed_mm_s if both are
//   given) hold       duration_s arc        center_mm, normal, angle_deg, speed_mm_s: turns about
//   the axis through the centre, right-
//              handed about the normal; the radius is the start's distance from that axis
//   waypoints  points_mm, speed_mm_s: straight legs
//   lattice    origin_mm, u_mm, v_mm (edges of the pocket), step_mm, speed_mm_s; layers (1),
//              layer_depth_mm, plunge_speed_mm_s (speed_mm_s): goes straight to origin_mm, then
//              mills layer k = 1, 2, ... at k * layer_depth_mm below it (against the bur's axis at
//              the segment's start) in passes along +-u, at most step_mm apart and equally spaced,
//              so that the last runs along the far edge. Each layer is entered by a plunge where
//              the one before ended, and goes back over the passes. Without layer_depth_mm one
//              layer at origin_mm.
// Any segment may turn the bur over its duration: `axis` by the shortest arc from its present axis
// (slerp), `spin_deg` about its own axis. `pedal` = false switches the motor off during the
// segment.
//
// Samples stand at exactly i / rate_hz across all segments; the last one, at or just after the end,
// is the end pose. Throws InputError with the key, e.g. "segment[3].speed_mm_s", also for more than
// 24 h or kMostSamples.
Trajectory read_script(const std::string& path);
Trajectory parse_script(const std::string& toml, const std::string& where);

// Samples at exactly start + i * time_step, i = 0, 1, ...: positions linear, orientations slerp,
// buttons of the latest sample. The last one is the last that does not lie behind the trajectory's
// end. A trajectory that already has these times (to 1e-9 s) is returned bit for bit. A gap above
// 0.1 s is an InputError naming the time, unless `allow_gaps`.
std::vector<HandleSample> resample(const Trajectory& trajectory, double time_step, bool allow_gaps,
                                   const std::string& where);

}  // namespace toothprep
