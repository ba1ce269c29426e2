// What a session and an active check have in common: every tick to the recorder and the figures.
#pragma once

#include <functional>
#include <string>

#include "toothprep/tools/display/display_surface.h"
#include "toothprep/tools/files/session_recorder.h"
#include "toothprep/tools/live_session/live_session.h"
#include "toothprep/tools/live_session/recorded_run.h"

namespace toothprep {

class TickSinks final : public TickSink {
 public:
  // `display` and `onlooker` may be nullptr.
  TickSinks(SessionRecorder& recorder, DisplaySurface* display, Onlooker* onlooker)
      : recorder_(recorder), display_(display), onlooker_(onlooker) {}
  void take(const LiveTick& tick) noexcept override {
    statistics.add(tick);
    recorder_.push(tick);
    if (display_ && !(tick.flags & kPaused)) display_->tick();  // else the main thread does
    if (onlooker_) onlooker_->take(tick);
  }
  TickStatistics statistics;

 private:
  SessionRecorder& recorder_;
  DisplaySurface* display_;
  Onlooker* onlooker_;
};

// The watch, with a line to `warn` when the recording stops while the session goes on.
LiveWatch with_recorder_watched(LiveWatch watch, const SessionRecorder& recorder,
                                std::function<void(const std::string&)> warn);

// Closes the recording. Doesn't throw: what fails stands in the result.
RecordedRun close_recording(SessionRecorder& recorder, const EnergyAudit& audit, LiveEnd end,
                            const TickStatistics& ticks);

}  // namespace toothprep
