// Trace files (.h5): what a replay or a live session records, and the format of recorded
// trajectories.
#pragma once

#include <string>
#include <vector>

#include "toothprep/step/core/session_event.h"
#include "toothprep/step/core/step_record.h"
#include "toothprep/step/tooth/tooth_bodies.h"
#include "toothprep/tools/io/read_policy.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {

// The energy audit: the torque's work against what was removed. mJ.
struct EnergyAudit {
  double torque_work_mj = 0;     // integral of 2 pi N T_z over the steps that turn
  double removed_energy_mj = 0;  // sum over tissues of u_k V_k
  double energy_ratio = 0;       // their quotient; NaN when nothing was removed
};

struct Trace {                       // a trace file in memory
  std::vector<StepRecord> rows;      // row 0 is the initial state with zero forces
  std::string parameters_toml;       // complete
  std::string tooth_sha256;          // of the tooth before the first step (layered_tooth.h)
  std::string toothprep_version;     // that wrote it
  std::string bur;                   // the --bur text
  std::string drive, engine;         // as name_of() says
  EnergyAudit audit;                 // of the whole run
  double initial_overlap_mm3 = 0;    // removed before the first step; not in the audit
  std::vector<Vec3> measured_force;  // N; empty or one per row
  SessionEvents events;              // what was done to a live session; then schema_version is 2
  bool unfinished = false;           // a live recording that was not closed: killed, or it runs
  // Of a tooth with several; then there is /contact/body_area, a column each.
  std::vector<Body> bodies;
  // More than 1: of the run's rows it holds every such one, the last, and those with events.
  std::size_t rows_every = 1;
};

// The trace with every `every`-th row only, bit for bit, and as Trace::rows_every says. The audit
// stays that of the whole run.
[[nodiscard]] Trace every_nth_row(const Trace& trace, std::size_t every);

// The warning of a trace or trajectory `path` that holds every `every`-th step only.
[[nodiscard]] std::string sparse_text(const std::string& path, std::size_t every);

// The warning of a live recording `path` that was not closed.
[[nodiscard]] std::string unfinished_text(const std::string& path);

// Writes `path` itself (callers go through Outputs); same trace, same bytes (no object times).
// Throws Error if it holds no rows or a value that is not finite, or if the disk is full.
// Chunked, shuffled, gzip 4; the datasets are those of trace_columns.cpp.
void write_trace(const Trace& trace, const std::string& path);

// Reads a complete trace back, bit for bit (the power, stored in W, to one unit in the last place).
// Throws InputError (file, dataset, condition): unreadable, truncated, another schema, a dataset
// missing, of wrong shape or type, claiming more than kMostSamples rows, in another unit, not
// finite. The unit is required for time, positions and forces. /handle/buttons (absent: always on),
// /contact/shank_area, /force/measured and /force/applied (written by the drive `load`) may be
// absent; a tissue that `tissues` doesn't name has
// zeros. Of a live recording that is being written or was cut off: the rows up to the last flush,
// the audit NaN.
[[nodiscard]] Trace read_trace(const std::string& path, ReadPolicy policy = ReadPolicy::kTrial);

// Whether an HDF5 file says that it is a trace (root attribute `schema`). Throws InputError if it
// can't be read at all.
[[nodiscard]] bool is_trace_file(const std::string& path, ReadPolicy policy = ReadPolicy::kTrial);

// Reads what a trajectory needs: /time and /handle/position with units; /handle/orientation,
// /handle/buttons, /force/measured and /force/applied (the load) where present. Any HDF5 file will do, whoever wrote it; other
// datasets are ignored. Errors as read_trace, and fewer than two samples.
[[nodiscard]] Trajectory read_h5_trajectory(const std::string& path,
                                            ReadPolicy policy = ReadPolicy::kTrial);

// Whether an HDF5 file has what read_h5_trajectory() needs: /time and /handle/position.
[[nodiscard]] bool holds_trajectory(const std::string& path,
                                    ReadPolicy policy = ReadPolicy::kTrial);

// One row per step, one column per component, unit in the column's name: time_s, handle_x_mm, ...,
// force_device_x_N, ..., removed_enamel_mm3; shortest decimals that read back as the same doubles.
void write_trace_csv(const Trace& trace, const std::string& path);

}  // namespace toothprep
