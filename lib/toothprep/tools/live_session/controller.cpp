#include "toothprep/tools/live_session/controller.h"

#include <utility>

#include "toothprep/step/core/errors.h"

namespace toothprep {

Controller::Controller(SessionControl* control, LiveLoop& loop, Workpiece& workpiece,
                       const Parameters& parameters, Drive drive, const std::vector<NamedBur>& burs,
                       DisplaySurface* display, std::function<void(const std::string&)> note)
    : control_(control),
      loop_(loop),
      workpiece_(workpiece),
      burs_(burs),
      display_(display),
      note_(std::move(note)),
      intervals_(workpiece, parameters, drive) {}

Session& Controller::begin(const Bur& bur, const Pose& handle) {
  HandleSample first;
  first.pose = handle;
  Session& session = intervals_.begin(bur, first);
  show(ControlState::kRunning);
  return session;
}

std::string Controller::attend() {
  if (!control_) return {};
  if (state_ == ControlState::kPausing && loop_.paused()) {
    intervals_.end();
    show(ControlState::kPaused);
  }
  const bool holds = state_ == ControlState::kPaused || state_ == ControlState::kResuming;
  if (holds && display_) display_->tick();  // else the servo does
  if (loop_.posted()) return {};
  if (state_ == ControlState::kEnding) return "ended from the page";
  take_command();
  if (state_ == ControlState::kResuming) try_to_resume();
  return {};
}

void Controller::take_command() {
  const auto command = control_->next();
  if (!command || carry_out(*command)) return;
  const char* why = state_ == ControlState::kRunning ? ": pause first" : ": not now";
  if (command->kind == EventKind::kUndo && state_ == ControlState::kPaused)
    why = ": nothing is left to undo";
  if (command->kind == EventKind::kBur && state_ == ControlState::kPaused) why = ": no such bur";
  show(state_, std::string(name_of(command->kind)) + why);
}

// False: it can't be done now.
bool Controller::carry_out(const ControlCommand& command) {
  const EventKind kind = command.kind;
  const bool paused = state_ == ControlState::kPaused, running = state_ == ControlState::kRunning;
  if (kind == EventKind::kEnd) {
    if (paused || running) post(kind);
    show(ControlState::kEnding);
    return true;
  }
  if (kind == EventKind::kPause) {
    if (state_ == ControlState::kResuming) {  // it still is
      show(ControlState::kPaused);
      return true;
    }
    if (!running || !post(kind)) return false;
    show(ControlState::kPausing);
    return true;
  }
  if (!paused) return false;
  LiveCommand act;
  if (kind == EventKind::kUndo) {
    if (!intervals_.undo()) return false;
    act.removed = intervals_.removed_before();
  } else if (kind == EventKind::kBur) {
    if (command.bur < 0 || command.bur >= static_cast<int>(burs_.size())) return false;
    bur_ = command.bur;
    act.arguments[0] = bur_;
  } else if (kind == EventKind::kRegistration) {
    act.shift = command.shift;
    act.turn = command.turn;
  } else if (kind == EventKind::kResume) {
    starts_.emplace(burs_[static_cast<std::size_t>(bur_)].bur, workpiece_, false, note_);
    show(ControlState::kResuming, "move the hand until the bur is clear of the tooth");
    return true;
  }
  post(kind, act);
  show(state_);
  return true;
}

bool Controller::post(EventKind kind, LiveCommand command) {
  command.kind = kind;
  return loop_.post(command);
}

void Controller::try_to_resume() {
  HandleSample first;
  first.pose = loop_.paused_handle();
  if (!starts_->may_start(first.pose)) return;
  LiveCommand act;
  act.removed = intervals_.removed_before();
  try {
    act.session = &intervals_.begin(burs_[static_cast<std::size_t>(bur_)].bur, first);
  } catch (const Error& e) {
    return show(ControlState::kPaused, e.what());
  }
  post(EventKind::kResume, act);
  show(ControlState::kRunning);
}

void Controller::show(ControlState state, std::string note) {
  state_ = state;
  if (!control_) return;
  ControlStatus status;
  status.state = state;
  status.bur = bur_;
  status.undoable = static_cast<int>(intervals_.undoable());
  status.note = std::move(note);
  control_->show(std::move(status));
}

}  // namespace toothprep
