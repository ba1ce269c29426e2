// How a preparation was made: figures and events of a recording.
//
// Row i stands for the step from time[i-1] to time[i], h_i long; row 0 is the initial state and
// spans nothing. Per row:
//
//   removed   what /removed/volume grew by, over all tissues; never below 0
//   contact   advancing contact area above 0 in any tissue, or removed > 0. The area is that of the
//             surface which advances into tissue, so a bur that only rests on a wall is not in
//             contact; while the bur stalls it is that of the motion which it was stopped in
//   cutting   contact, and not stalled
//   F         |grinding force|, N; "felt" is |device force|
//
// Sums run over the rows in order. The figures and their definitions are the rows "process.*" of
// definitions.cpp. Not valid for a recording with pauses in it: time that was not recorded
// counts as the step after it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/core/step_record.h"
#include "toothprep/step/tooth/tooth_bodies.h"
#include "toothprep/tools/preparation/quantity.h"

namespace toothprep {

struct ProcessOptions {       // limits of the figures
  double force_limit = 2.0;   // N: time above it; a convention
  double power_limit = 1000;  // N·mm/s (1 W): time above it; a convention
  double shortest_gap = 0.1;  // s: what is interrupted for less is one episode
};

enum class ProcessEventKind { kContact, kStall, kPulp, kNeighbour, kForceLimit };  // what lasted
[[nodiscard]] const char* name_of(
    ProcessEventKind kind) noexcept;  // "contact", "stall", "pulp touched", ...

// Something that lasted from `begin` to `end` (s), interruptions below the shortest gap included.
struct ProcessEvent {
  double begin = 0, end = 0;                           // s
  ProcessEventKind kind = ProcessEventKind::kContact;  // which
};

struct ProcessFigures {              // of a recording
  Quantities quantities;             // keys "process.*"; those that would divide by 0 are absent
  std::vector<ProcessEvent> events;  // by their begin; of the same begin, in the order of the kinds
};

// Throws Error for fewer than two rows, times that don't increase, or limits that are not finite
// and above 0.
// `starts`: indices at which another recording begins, whose first row is no step. `bodies`: of the
// recording; then contact with neighbours and gum is that of the bodies, by the rows' areas.
[[nodiscard]] ProcessFigures process_figures(const std::vector<StepRecord>& rows,
                                             const ProcessOptions& options,
                                             const std::vector<std::size_t>& starts = {},
                                             const std::vector<Body>& bodies = {});

// Appends a recording made after those before it: its time goes on where theirs ends, and so does
// the removed volume. Returns the index of its first row.
std::size_t append_recording(std::vector<StepRecord>& rows, const std::vector<StepRecord>& next);

}  // namespace toothprep
