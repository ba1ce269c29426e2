// An active check of a rig (rig_check/protocol.h) on a device, recorded.
#pragma once

#include <functional>
#include <string>

#include "toothprep/tools/live_session/recorded_run.h"
#include "toothprep/tools/rig_check/protocol.h"

namespace toothprep {

// Runs the protocol to its end, unless the watch ends it before. Throws Error as run_live_session().
RecordedRun run_active_check(HapticDevice& device, const Protocol& protocol,
                             const ForceLimits& limits, const ReadingLimits& readings,
                             bool safety_switch, LiveWatch watch,
                             const std::function<void(const std::string&)>& warn,
                             RecordTarget target);

}  // namespace toothprep
