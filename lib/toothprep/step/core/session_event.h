// What was done to a session from outside while it ran, each in the row of a step.
//
//   pause         the force is ramped out; with this row an interval of the session ends: what is due
//                 is removed, and the rows that follow are no steps (rejected), the bur stays
//   resume        an interval begins: a session of its own, with the bur where the handle is
//   undo          in a pause: the tooth, and what was removed of it, as at the start of the last
//                 interval that was not undone
//   bur           in a pause: another bur; argument 0: its place in the list of burs
//   registration  in a pause: the tooth moves under the hand; arguments: x_W = t + R x_D from now on,
//                 t (mm) and R (x, y, z, w)
//   end           asked for
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace toothprep {
// As above; the numbers of files.
enum class EventKind : std::uint32_t { kNone, kPause, kResume, kUndo, kBur, kRegistration, kEnd };
constexpr int kEventKinds = 7;  // with none
// "pause", ...
[[nodiscard]] constexpr std::string_view name_of(EventKind kind) {
  constexpr std::string_view names[kEventKinds] = {"",    "pause",        "resume", "undo",
                                                   "bur", "registration", "end"};
  return names[static_cast<std::uint32_t>(kind)];
}

constexpr int kEventArguments = 7;  // the most
// One of them.
struct SessionEvent {
  double time = 0;                                  // s, of its row
  EventKind kind = EventKind::kNone;                // what
  std::array<double, kEventArguments> arguments{};  // or 0
};
// Of a recording.
struct SessionEvents {
  std::vector<SessionEvent> events;  // in order of time
  std::vector<std::string> burs;  // that can be changed to, as --bur takes them; 0: the first one
};

}  // namespace toothprep
