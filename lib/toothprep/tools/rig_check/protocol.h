// Active checks of a rig: what the device is asked to do, in words and as values. A recording's
// header carries the words, so that whoever reads it knows what was tried when.
//
//   rest [10 s]                                               zero force, nobody touches the handle
//   step [0.5 N for 2 s]                                      a constant force, on and off again
//   stiffness-sweep [0.2..2 N/mm in 10 steps of 2 s]          F = -k (x - x_0), k level by level
//   damping-sweep [1..100 N*s/m in 9 geometric steps of 2 s]  F = -B (x_n - x_n-1)/T, B likewise
//   wall [1 N/mm travel 3 mm for 10 s]                        F = k d along the wall's normal
//
// What stands in brackets may be left out as a whole: it is the default. Spaces separate the words;
// between a number and its unit they may be left out. N·s/m is read as well as N*s/m.
//
// Time of a protocol is that of the recording's rows (steps times T), t = 0 at the first tick.
// Every protocol begins with kProtocolLead of zero force, in which the device's ramp comes up and
// rest can be measured:
//
//   rest     lead, then zero force for the duration
//   step     lead, zero for a quarter of the duration, force_n for half of it, zero for a quarter
//   sweeps   lead, then level i during [lead + i hold, lead + (i + 1) hold), i = 0 ... count - 1
//   wall     lead, then the wall for the duration; d, the depth behind its plane, counts up to the
//            travel and no further, so that the force is k travel at most
//
// The directions are the caller's: what analyses a recording takes them from the forces.
#pragma once

#include <optional>
#include <string>

namespace toothprep {

enum class ProtocolKind { kRest, kStep, kStiffnessSweep, kDampingSweep, kWall };

constexpr double kProtocolLead = 1.0;  // s of zero force

// Members that a kind doesn't use are zero.
struct Protocol {
  ProtocolKind kind = ProtocolKind::kRest;
  double duration_s = 0;          // rest, step, wall; (0, 3600]
  double force_n = 0;             // step; (0, 5]
  double from = 0, to = 0;        // sweeps: N/mm, (0, 10], or N·s/m, (0, 10000]; from < to
  int count = 0;                  // sweeps, of the levels; 2 to 100
  double hold_s = 0;              // sweeps; [0.5, 60]
  bool geometric = false;         // sweeps: equal ratios between the levels, else equal differences
  double stiffness_n_per_mm = 0;  // wall; (0, 10]
  double travel_mm = 0;           // wall; (0, 50]

  bool operator==(const Protocol&) const = default;
};

// "rest", "step", "stiffness-sweep", "damping-sweep", "wall".
const char* name_of(ProtocolKind kind) noexcept;

// The kind with its defaults.
Protocol default_protocol(ProtocolKind kind);

// Throws Error that names the first violated condition.
void validate(const Protocol& protocol);

// Throws Error that says what was not understood and what would be. The result is validated.
Protocol parse_protocol(const std::string& text);

// The complete words; parse_protocol() turns them into the same values, bit for bit. ASCII.
std::string print_protocol(const Protocol& protocol);

// From the first tick to the end of the last phase, s.
double protocol_duration(const Protocol& protocol) noexcept;

// Level 0 ... count - 1 of a sweep at a time, s; nothing during the lead, after the end and for
// other kinds.
std::optional<int> protocol_level_at(const Protocol& protocol, double time) noexcept;

// The sweep's own unit: N/mm or N·s/m. The first and the last are `from` and `to` exactly.
double protocol_level(const Protocol& protocol, int level) noexcept;

// Whether a step's force is on at a time, s.
bool protocol_step_on(const Protocol& protocol, double time) noexcept;

}  // namespace toothprep
