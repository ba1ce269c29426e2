// A simulated device, a hand that follows an intended path, and any rendering, in a closed loop:
//
//   row n (time n T):  encoder reading -> render(n, reading) -> force, held until row n + 1
//
// Row 0 is the initial state: no force, render not called. So the rows are those of a trace, whose
// handle is the encoder reading and whose device force is computed from it.
#pragma once

#include <cstddef>
#include <vector>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/device/simulated_phantom.h"

namespace toothprep {

struct ClosedLoopSeries {
  std::vector<double> time;    // s
  std::vector<Vec3> intended;  // mm, p
  std::vector<Vec3> position;  // mm, the handle's true position
  std::vector<Vec3> velocity;  // mm/s, the handle's true velocity
  std::vector<Vec3> encoder;   // mm, what render was given
  std::vector<Vec3> command;   // N, what render returned
  std::vector<Vec3> force;  // N, what the motors hold from this row to the next: limited, delayed
};

// Moves `phantom` along `intended_path` (mm, one point per tick, the first where it starts).
// `render(std::size_t tick, const Vec3& encoder_position)` returns the force on the handle, N. The
// last row's force is held for a tick in which the intended position rests. Throws Error for an
// empty path.
template <class Render>
ClosedLoopSeries run_closed_loop(SimulatedPhantom& phantom, const std::vector<Vec3>& intended_path,
                                 Render&& render) {
  if (intended_path.empty()) throw Error("closed loop: the intended path has no points");
  const std::size_t rows = intended_path.size();
  ClosedLoopSeries s;
  s.time.reserve(rows);
  for (auto* column : {&s.intended, &s.position, &s.velocity, &s.encoder, &s.command, &s.force})
    column->reserve(rows);
  for (std::size_t n = 0; n < rows; ++n) {
    s.time.push_back(static_cast<double>(n) * phantom.model().time_step());
    s.intended.push_back(intended_path[n]);
    s.position.push_back(phantom.true_position());
    s.velocity.push_back(phantom.true_velocity());
    s.encoder.push_back(phantom.encoder_position());
    s.command.push_back(n == 0 ? Vec3(Vec3::Zero()) : Vec3(render(n, s.encoder.back())));
    phantom.tick(s.command.back(), intended_path[n + 1 < rows ? n + 1 : n]);
    s.force.push_back(phantom.motor_force());
  }
  return s;
}

// How a loop behaves while the hand pulls steadily forward against something that only resists.
//
//   stable    it moves forward or rests (kBackwardTolerated aside). Against a hand that pulls
//             forward, what only dissipates cannot push the handle backward, and the ringing of a
//             spring in between dies away while settling: backward motion is the loop's own doing.
//   vibrates  it moves backward in some of the samples: a limit cycle that the encoder's counts
//             feed and that stays inside the motors' range.
//   unstable  the motors are at their limit: nothing but the limit bounds the motion.
enum class LoopVerdict { kStable, kVibrates, kUnstable };

constexpr double kVibrationCorner = 20;       // Hz: above it lies no voluntary motion of a hand
constexpr double kBackwardTolerated = 0.002;  // fraction of the samples, still called stable
constexpr double kSaturatedTolerated = 0.01;  // fraction of the samples, not yet called unstable

struct ClosedLoopFigures {
  double force_peak_to_peak = 0;  // N, of the motors' force along `direction`
  double force_rms_above_20 = 0;  // N, of the same, above kVibrationCorner
  double backward_fraction = 0;   // of the samples: true velocity against `direction`
  double saturated_fraction = 0;  // of the samples: motors' force at the limit
  LoopVerdict verdict = LoopVerdict::kStable;
};

// Figures of the rows from `settling` (s) on. `direction`: where the hand pulls, not zero.
// `model`: the device's, for its rate and force limit. Throws Error if fewer than 0.1 s are left.
ClosedLoopFigures closed_loop_figures(const ClosedLoopSeries& series, const PhantomModel& model,
                                      const Vec3& direction, double settling = 0);

}  // namespace toothprep
