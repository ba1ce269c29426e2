#include "toothprep/tools/device/closed_loop.h"

#include <algorithm>
#include <cmath>

#include "toothprep/tools/device/high_pass_rms.h"

namespace toothprep {

ClosedLoopFigures closed_loop_figures(const ClosedLoopSeries& series, const PhantomModel& model,
                                      const Vec3& direction, double settling) {
  const double length = direction.norm();
  if (!(std::isfinite(length) && length > 0))
    throw Error("closed loop: the direction must be finite and not zero");
  const Vec3 along = direction / length;
  const auto from = static_cast<std::size_t>(
      std::lower_bound(series.time.begin(), series.time.end(), settling - 1e-9) -
      series.time.begin());
  const std::size_t rows = series.time.size() - from;
  if (static_cast<double>(rows) < 0.1 * model.rate)
    throw Error("closed loop: fewer than 0.1 s are left after settling");

  std::vector<double> force(rows);
  std::size_t backward = 0, saturated = 0;
  for (std::size_t i = 0; i < rows; ++i) {
    force[i] = series.force[from + i].dot(along);
    backward += series.velocity[from + i].dot(along) < 0;
    // The limit is reached up to the rounding of the division that scales the force.
    saturated += series.force[from + i].norm() >= model.force_limit * (1 - 1e-9);
  }
  const auto [least, most] = std::minmax_element(force.begin(), force.end());
  ClosedLoopFigures f;
  f.force_peak_to_peak = *most - *least;
  f.force_rms_above_20 = rms_above(force, model.rate, kVibrationCorner);
  f.backward_fraction = static_cast<double>(backward) / static_cast<double>(rows);
  f.saturated_fraction = static_cast<double>(saturated) / static_cast<double>(rows);
  f.verdict = f.saturated_fraction > kSaturatedTolerated ? LoopVerdict::kUnstable
              : f.backward_fraction > kBackwardTolerated ? LoopVerdict::kVibrates
                                                         : LoopVerdict::kStable;
  return f;
}

}  // namespace toothprep
