#include "toothprep/tools/live_session/tick_sinks.h"

#include "toothprep/step/core/errors.h"

namespace toothprep {

LiveWatch with_recorder_watched(LiveWatch watch, const SessionRecorder& recorder,
                                std::function<void(const std::string&)> warn) {
  watch.report = [&recorder, warn = std::move(warn), report = std::move(watch.report),
                  warned = false](const LiveStatus& s, const DeviceStatus& d) mutable {
    if (!warned && recorder.failure()) {
      warned = true;
      if (warn) warn("the recording stopped: " + *recorder.failure() + "; the session goes on");
    }
    if (report) report(s, d);
  };
  return watch;
}

RecordedRun close_recording(SessionRecorder& recorder, const EnergyAudit& audit, LiveEnd end,
                            const TickStatistics& ticks) {
  RecordedRun run;
  try {
    recorder.finish({audit, end.reason});
  } catch (const Error& e) {
    run.failure = e.what();
  }
  run.end = std::move(end);
  run.ticks = ticks;
  run.rows = recorder.rows();
  run.dropped = recorder.dropped();
  return run;
}

}  // namespace toothprep
