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

// Root attributes of the session's limits.
struct SafetyAttribute {
  const char* name;
  double SafetyLimits::*value;
};
inline constexpr SafetyAttribute kSafetyAttributes[] = {
    {"force_ramp_s", &SafetyLimits::force_ramp},
    {"force_fade_s", &SafetyLimits::force_fade},
    {"stale_limit_s", &SafetyLimits::stale},
    {"frozen_limit_s", &SafetyLimits::frozen},
    {"vibration_limit_n", &SafetyLimits::vibration_force},
    {"vibration_time_s", &SafetyLimits::vibration_time},
    {"heat_time_s", &SafetyLimits::heat_time},
    {"speed_limit_mm_per_s", &SafetyLimits::speed}};

}  // namespace toothprep
