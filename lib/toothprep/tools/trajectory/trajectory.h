// Commanded motions of the handle: scripts (.toml), recordings (.csv; .h5 is read by the trace
// module), and their resampling to the step rate.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "toothprep/step/core/session_event.h"
#include "toothprep/step/core/step_record.h"

namespace toothprep {

// More samples than this (5.5 hours at 1 kHz) are refused by every reader: a mistake in a rate or a
// clock, not a preparation, and a trace of them would not fit into memory.
constexpr std::size_t kMostSamples = 20'000'000;

struct Trajectory {                   // a commanded motion, at any rate
  std::vector<HandleSample> samples;  // time strictly increasing
  std::vector<Vec3> measured_force;   // N, tooth on bur, W; empty or one per sample
  bool loaded = false;                // the samples' `load` is given
  SessionEvents events;               // of a live session that was paused, changed, taken back
  bool unfinished = false;            // of a live recording that was not closed: killed, or it runs
  std::size_t rows_every = 1;         // more: of a trace's steps it holds every such one only
};

// Takes a recorded quaternion as an orientation: false unless its length is 1 to 1e-3. It is
// normalised only where it needs to be, so that what this toolkit wrote is read back bit for bit.
[[nodiscard]] bool accept_quaternion(const Quat& recorded, Quat& orientation);

// Reads `time_s,x_mm,y_mm,z_mm[,qx,qy,qz,qw][,buttons][,fx_N,fy_N,fz_N]
// [,load_x_N,load_y_N,load_z_N]`. Throws InputError with
// the line and column for anything else: wrong header, a missing unit, NaN, time that does not
// increase, a quaternion that is not of unit length (to 1e-3; it is normalised), fewer than two
// samples. Columns are found by name, so their order is free.
[[nodiscard]] Trajectory read_csv_trajectory(const std::string& path);
// The same of a table that may have further columns, named in `also`: those that it has go to
// `further` by their name, a finite value per sample.
[[nodiscard]] Trajectory read_csv_trajectory(const std::string& path,
                                             const std::vector<std::string>& also,
                                             std::map<std::string, std::vector<double>>& further);

// Runs a trajectory script (.toml): a start pose, then segments `line`, `hold`, `arc`, `waypoints`
// and `lattice`. Every key is described in data/trajectories/README.md.
//
// Samples stand at exactly i / rate_hz across all segments; the last one, at or just after the end,
// is the end pose. Throws InputError with the key, e.g. "segment[3].speed_mm_s", also for more than
// 24 h or kMostSamples.
[[nodiscard]] Trajectory read_script(const std::string& path);
[[nodiscard]] Trajectory parse_script(const std::string& toml, const std::string& where);

// Samples at exactly start + i * time_step, i = 0, 1, ...: positions and loads linear, orientations slerp,
// buttons of the latest sample. The last one is the last that does not lie behind the trajectory's
// end. A trajectory that already has these times (to 1e-9 s) is returned bit for bit, with its
// rejected samples; otherwise these are left out before anything is interpolated. A gap above
// 0.1 s is an InputError naming the time, unless `allow_gaps`.
[[nodiscard]] std::vector<HandleSample> resample(const Trajectory& trajectory, double time_step,
                                                 bool allow_gaps, const std::string& where);

// Whether a reading of the motion was rejected.
[[nodiscard]] bool any_rejected(const Trajectory& trajectory);
// The trajectory without the samples that are rejected, and without their forces.
[[nodiscard]] Trajectory without_rejected(const Trajectory& trajectory);

// Throws InputError if a run along the motion that was read from `path` takes more memory than
// there is.
void check_run_memory(const std::string& path, const Trajectory& motion, double time_step);

}  // namespace toothprep
