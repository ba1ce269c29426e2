// The options of what steps a session, replayed or live: tooth, bur, parameters.
#pragma once

#include <optional>
#include <string>

#include "command.h"
#include "toothprep/step/core/parameters.h"

namespace toothprep::app {

struct SessionOptions {
  std::string tooth, bur, params, preset, drive = "coupled", engine;
  std::optional<double> stiffness, damping, rotation_rate, stall_torque, time_step;
};

// None is required by the parser but checked by the command, so that `--bur list` works alone.
void add_session_options(CLI::App& sub, SessionOptions& options);

// Preset, file and flags, each over the one before; validated.
Parameters load_parameters(const SessionOptions& options);

Drive drive_of(const SessionOptions& options);

// On stdout.
void print_bur_library();

}  // namespace toothprep::app
