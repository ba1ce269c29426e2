// Carries out what is asked of a running session (SessionControl), on the session's main thread:
// what takes time is done while the servo leaves session and tooth alone (LiveLoop, pause).
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/session/intervals.h"
#include "toothprep/tools/display/display_surface.h"
#include "toothprep/tools/live/live_loop.h"
#include "toothprep/tools/live/session_control.h"
#include "toothprep/tools/live_session/live_session.h"
#include "toothprep/tools/live_session/start_rule.h"

namespace toothprep {

class Controller {
 public:
  // `control` and `display` may be nullptr; `burs` begins with the one of the start.
  Controller(SessionControl* control, LiveLoop& loop, Workpiece& workpiece,
             const Parameters& parameters, Drive drive, const std::vector<NamedBur>& burs,
             DisplaySurface* display, std::function<void(const std::string&)> note);

  // The session begins where the handle is.
  Session& begin(const Bur& bur, const Pose& handle);
  // Every few ms; the reason to end, else empty.
  std::string attend();
  const Intervals& intervals() const { return intervals_; }

 private:
  void take_command();
  bool carry_out(const ControlCommand& command);
  bool post(EventKind kind, LiveCommand command = {});
  void try_to_resume();
  void show(ControlState state, std::string note = {});

  SessionControl* control_;
  LiveLoop& loop_;
  Workpiece& workpiece_;
  const std::vector<NamedBur>& burs_;
  DisplaySurface* display_;
  std::function<void(const std::string&)> note_;
  Intervals intervals_;
  ControlState state_ = ControlState::kStarting;
  int bur_ = 0;
  std::optional<StartRule> starts_;  // while it is resumed
};

}  // namespace toothprep
