// The one table of what a recording holds beyond a trace (trace_columns.h): a row per tick.
// Recorder and reader follow it.
#pragma once

#include <vector>

#include "toothprep/step/core/live_tick.h"
#include "toothprep/tools/files/session_file.h"
#include "toothprep/tools/files/trace_columns.h"

namespace toothprep {

struct SessionColumn {
  const char* dataset;
  const char* unit;
  int width;
  Storage storage;
  bool mirror;  // only if there is a second device
  void (*get)(const LiveTick& tick, double* values);
  void (*add)(SessionRecording& recording, const double* values);  // one row more
};

const std::vector<SessionColumn>& session_columns();

}  // namespace toothprep
