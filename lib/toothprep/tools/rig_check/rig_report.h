// A recording judged line by line: each figure beside its limit.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/rig_check/protocol_figures.h"
#include "toothprep/tools/rig_check/rig_figures.h"
#include "toothprep/tools/rig_check/rig_limits.h"

namespace toothprep {

// One figure that a limit may be given for; its key carries the unit.
struct RigFigure {
  const char* key;
  const char* section;  // "servo", "encoders", ...
  const char* unit;
  const char* meaning;  // one line, for people
};
// All of them, in the order of the report.
const std::vector<RigFigure>& rig_catalogue();

enum class RigVerdict {
  kPass,
  kFail,
  kNotMeasured,  // `why_not` says why
  kNoLimit       // reported only
};
const char* name_of(RigVerdict verdict) noexcept;

struct RigLine {
  const RigFigure* figure = nullptr;
  std::optional<double> value;
  std::string why_not;  // not measured because
  std::string note;     // what else is to be known of it; may be empty
  std::optional<RigLimit> limit;
  RigVerdict verdict = RigVerdict::kNoLimit;
};

struct RigReport {
  std::vector<RigLine> lines;              // one per figure of the catalogue
  RigVerdict overall = RigVerdict::kPass;  // kFail: a line fails; kNotMeasured: none has a verdict
  int passed = 0, failed = 0, not_measured = 0;  // of the lines with a limit

  // What the lines were taken from, for the page.
  std::vector<EventFigures> events;
  std::vector<FaultFigures> faults;
  std::optional<DeviceTraits> device;
  std::optional<Protocol> protocol;
  std::optional<ServoFigures> servo;
  std::optional<StepCostFigures> step_cost;
  std::optional<DevicePortFigures> device_port;
  std::optional<StepFigures> step;
  std::optional<SweepFigures> sweep;
  std::optional<WallFigures> wall;
};

// `replayed`: the rows of the recording's own path run again (step/session/replay.h), or why there are
// none. Throws Error as check_recording() does, and for a recording whose parameters or protocol
// don't parse.
RigReport check_rig(const SessionRecording& recording, const RigLimits& limits,
                    const Measured<std::vector<StepRecord>>& replayed);

// The whole report as JSON text (schema toothprep-rig-check), keys flat and with their units.
// `session`: the recording's name; `version` and `build`: the program's.
std::string report_json(const RigReport& report, const SessionRecording& recording,
                        const std::string& session, const std::string& version,
                        const std::string& build);

// What scripts/plot-rig-check draws, beside report.json: periods.csv, step-cost.csv (histograms),
// trace.csv (thinned: least and most of each block), levels.csv and step.csv where there are.
void write_plot_data(const RigReport& report, const SessionRecording& recording,
                     const std::string& folder);

}  // namespace toothprep
