// Control of a session from outside its servo and its main thread: a page.
//
//   asking thread ──ask()──▶ queue ──▶ main thread ──LiveLoop::post()──▶ servo, at a tick's boundary
//                 ◀─status()─────────
//
// No thread of the session ever waits for the one that asks.
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>

#include "toothprep/step/core/geometry.h"
#include "toothprep/step/core/session_event.h"
#include "toothprep/step/core/spsc_ring.h"

namespace toothprep {

// What is asked for.
struct ControlCommand {
  EventKind kind = EventKind::kNone;  // what is to be done
  int bur = 0;                        // bur: its place in the session's list
  Vec3 shift = Vec3::Zero();          // registration: mm, W, of the handle against the hand
  Quat turn = Quat::Identity();       // registration: in W, about where the handle is
};
// What a session that is controlled does.
enum class ControlState { kStarting, kRunning, kPausing, kPaused, kResuming, kEnding };
// "paused", ...
[[nodiscard]] const char* name_of(ControlState state);

// For whoever asks.
struct ControlStatus {
  // What it does.
  ControlState state = ControlState::kStarting;
  int bur = 0;               // place in the list
  int undoable = 0;          // intervals
  std::string note;          // what is waited for, or why the last command was refused
  std::uint64_t change = 0;  // counts up with every change
};

// Between a session and whoever asks.
class SessionControl {
 public:
  // One thread. False: so many wait already.
  bool ask(const ControlCommand& command) { return asked_.push(command); }
  ControlStatus status() const;  // any thread

  // The session's main thread.
  std::optional<ControlCommand> next();
  void show(ControlStatus status);

 private:
  static constexpr std::size_t kMostWaiting = 32;
  SpscRing<ControlCommand> asked_{kMostWaiting};
  mutable std::mutex guard_;
  ControlStatus status_;
};

}  // namespace toothprep
