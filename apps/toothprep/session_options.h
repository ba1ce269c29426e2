// The options of what steps a session, replayed or live: tooth, bur, parameters.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "command.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/session/replay.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep::app {

struct SessionOptions {
  std::string tooth, bur, params, preset, drive = "coupled", engine;
  std::optional<double> stiffness, damping, rotation_rate, stall_torque, time_step;
  std::vector<double> load, rail;  // N and a direction, W; of replay alone
};

// None is required by the parser but checked by the command, so that `--bur list` works alone.
// `takes_load`: the drive `load`, too, with its options.
void add_session_options(CLI::App& sub, SessionOptions& options, bool takes_load = false);

// Puts the load on a path for the drive `load`: --load-n, else what the path itself holds. Throws
// InputError for a path without loads, for one that is zero throughout or beyond 1000 N.
void put_load(const SessionOptions& options, const std::string& file, Trajectory& path);

// Preset, file and flags, each over the one before; validated.
Parameters load_parameters(const SessionOptions& options);

Drive drive_of(const SessionOptions& options);

// What was done to the session that `source` records, for a replay with `bur`.
Interventions interventions_of(const SessionEvents& events, const Bur& bur,
                               const std::string& source);

// On stdout.
void print_bur_library();

}  // namespace toothprep::app
