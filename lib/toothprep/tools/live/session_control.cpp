#include "toothprep/tools/live/session_control.h"

#include <utility>

namespace toothprep {

const char* name_of(ControlState state) {
  switch (state) {
    case ControlState::kStarting:
      return "starting";
    case ControlState::kRunning:
      return "running";
    case ControlState::kPausing:
      return "pausing";
    case ControlState::kPaused:
      return "paused";
    case ControlState::kResuming:
      return "resuming";
    case ControlState::kEnding:
      break;
  }
  return "ending";
}

ControlStatus SessionControl::status() const {
  const std::lock_guard lock(guard_);
  return status_;
}

std::optional<ControlCommand> SessionControl::next() {
  ControlCommand command;
  if (!asked_.pop(command)) return {};
  return command;
}

void SessionControl::show(ControlStatus status) {
  const std::lock_guard lock(guard_);
  status.change = status_.change + 1;
  status_ = std::move(status);
}

}  // namespace toothprep
