// What the active checks (protocol.h) show. Symbols and alignment as in rig_figures.h; time is that
// of the protocol, of the rows. Forces are taken along u, the direction of their mean.
#pragma once

#include <string>
#include <vector>

#include "toothprep/tools/rig_check/protocol.h"
#include "toothprep/tools/rig_check/rig_figures.h"

namespace toothprep {

// Step of the force: what was sent, and how the handle answers.
struct StepFigures {
  double force = 0;                // N, median of what was sent while it was on
  double force_error_percent = 0;  // against the protocol's
  int latency_ticks = 0;    // from the command's jump to the sent force's, each at half height
  double displacement = 0;  // mm along u, mean of the last tenth while on, from before
  double rise_time = 0;     // s, 10 to 90 % of the displacement
  double overshoot_percent = 0;
  std::size_t onset = 0;  // row of the command's jump
};
Measured<StepFigures> step_figures(const SessionRecording& recording, const Protocol& protocol);

// One level of a sweep, its first settling_s left out.
//
//   unstable       the motors were at the limit in more than kSaturatedTolerated of the ticks, or
//                  it was stopped while it vibrated (0.2 N rms and more, or saturated)
//   vibrates       the rms above 20 Hz is above vibration_rms_n and above vibration_factor times
//                  what the counts alone make at the speed v: counts come at v/D, and each is
//                    for a damper   a pulse B D/T of one tick: B D/T sqrt(v T/D)
//                    for a spring   a step k D, whose part above f_0 = 20 Hz has the square
//                                   (k D)²/(2 pi² f_0): k D sqrt(v/(2 pi² f_0 D)), and no more than
//                                   k D/sqrt(12), when counts come faster
//                  v is without vibration: of means over 50 ms
//   stable         else
//   not exercised  it showed nothing: no force, or a damper moved more slowly than
//                  exercise_speed_mm_s
//   not run        fewer than half of its ticks are there
enum class LevelVerdict { kStable, kVibrates, kUnstable, kNotExercised, kNotRun };
const char* name_of(LevelVerdict verdict) noexcept;

struct LevelFigures {
  double level = 0;            // N/mm or N·s/m
  double rms_above_20 = 0;     // N, root of the sum of squares of the axes
  double counts_rms = 0;       // N, expected of the counts alone
  double peak_to_peak = 0;     // N, of the worst axis
  double saturated_share = 0;  // of the ticks
  double speed = 0;            // mm/s, v
  LevelVerdict verdict = LevelVerdict::kNotRun;
};
struct SweepFigures {
  std::vector<LevelFigures> levels;
  // The last before the first that vibrates or is unstable; those that weren't run or exercised
  // don't count. Empty: none.
  std::optional<double> last_stable;
  std::optional<double> first_vibrating, first_unstable;
};
// `count`: D, mm; 0 if unknown, then the counts' noise isn't allowed for.
Measured<SweepFigures> sweep_figures(const SessionRecording& recording, const Protocol& protocol,
                                     const RigMethod& method, double count);

// Against the wall: penetration against F/k, and whether it vibrates. The plane and the stiffness
// are the least-squares line of the force that was sent against the position that it answers,
// where the force was neither limited nor ramped.
struct WallFigures {
  double stiffness = 0, stiffness_ratio = 0;  // N/mm; over the protocol's
  double largest_force = 0;                   // N
  double penetration = 0;                     // mm, largest, behind the fitted plane
  double penetration_theory = 0;              // mm, the force there over k
  double contact_seconds = 0;                 // of the longest contact
  double vibration_rms = 0;                   // N above 20 Hz, in the longest contact
};
Measured<WallFigures> wall_figures(const SessionRecording& recording, const Protocol& protocol);

}  // namespace toothprep
