// Trace files (.h5): what a replay or a live session records, and the format of recorded trajectories.
#pragma once

#include <string>
#include <vector>

#include "toothprep/core/step_record.h"
#include "toothprep/trajectory/trajectory.h"

namespace toothprep {

// The energy audit: the torque's work against what was removed. mJ.
struct EnergyAudit {
  double torque_work_mj = 0;     // integral of 2 pi N T_z over the steps that turn
  double removed_energy_mj = 0;  // sum over tissues of u_k V_k
  double energy_ratio = 0;       // their quotient; NaN when nothing was removed
};

struct Trace {
  std::vector<StepRecord> rows;      // row 0 is the initial state with zero forces
  std::string parameters_toml;       // complete
  std::string tooth_sha256;
  std::string toothprep_version;
  std::string bur;                   // the --bur text
  std::string drive, engine;
  EnergyAudit audit;
  double initial_overlap_mm3 = 0;
  std::vector<Vec3> measured_force;  // N; empty or one per row
};

// Writes `path` itself (callers go through OutputFile); same trace, same bytes (no object times).
void write_trace(const Trace& trace, const std::string& path);

// Reads a complete trace back. Throws InputError (file, dataset, condition): unreadable, truncated,
// another schema, a dataset missing, of wrong shape or type, without its unit, not finite.
Trace read_trace(const std::string& path);

// Reads what a trajectory needs: /time and /handle/position with units; /handle/orientation,
// /handle/buttons and /force/measured where present. Lists more in errors as read_trace does.
Trajectory read_h5_trajectory(const std::string& path);

// One row per step, one column per component, unit in the column's name: time_s, handle_x_mm, ...,
// force_device_x_N, ..., removed_enamel_mm3.
void write_trace_csv(const Trace& trace, const std::string& path);

}  // namespace toothprep
