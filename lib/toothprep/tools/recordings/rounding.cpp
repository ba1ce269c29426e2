#include "toothprep/tools/recordings/rounding.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/statistics.h"

namespace toothprep {
namespace {

constexpr double kMattersFrom = 0.03;  // of the feed
constexpr double kFeedOver = 0.05;     // s, over which a feed is measured

// The step of which all differences are multiples; 0 if there is none.
double rounding_step(const std::vector<Vec3>& position) {
  double step = 0;
  std::size_t steps = 0;
  for (int axis = 0; axis < 3; ++axis)
    for (std::size_t i = 1; i < position.size(); ++i) {
      const double d = std::abs(position[i][axis] - position[i - 1][axis]);
      if (d > 1e-9 && (step == 0 || d < step)) step = d;
    }
  if (!(step > 0)) return 0;
  for (int axis = 0; axis < 3; ++axis)
    for (std::size_t i = 1; i < position.size(); ++i) {
      const double multiple = std::abs(position[i][axis] - position[i - 1][axis]) / step;
      if (std::abs(multiple - std::round(multiple)) > 0.02 + 1e-6 * multiple) return 0;
      steps += multiple > 1.5;
    }
  return steps > 10 ? step : 0;  // a feed of constant steps is no rounding
}

}  // namespace

bool MotionRounding::matters() const { return feed > 0 && velocity_jump >= kMattersFrom * feed; }

std::optional<MotionRounding> rounding_of(const std::vector<double>& time,
                                          const std::vector<Vec3>& position) {
  MotionRounding found;
  found.step = rounding_step(position);
  if (found.step == 0) return {};
  std::vector<double> speed, dt;
  const std::size_t apart = std::max<std::size_t>(1, time.size() / 2000);
  for (std::size_t i = 1; i < time.size(); ++i) dt.push_back(time[i] - time[i - 1]);
  const double tick = median(std::move(dt));
  const auto wide = static_cast<std::size_t>(std::max(1.0, kFeedOver / tick));
  for (std::size_t i = wide; i < time.size(); i += apart) {
    const double v = (position[i] - position[i - wide]).norm() / (time[i] - time[i - wide]);
    if (v > 0.01) speed.push_back(v);
  }
  found.velocity_jump = found.step / std::sqrt(6.0) / tick;
  if (speed.empty()) return found;
  found.feed = median(std::move(speed));
  // A local quadratic over n samples leaves sqrt(12 / n^3) of the noise of a position in a velocity.
  const double n = std::cbrt(
      12 * std::pow(found.step / std::sqrt(12.0) / tick / (kMattersFrom * found.feed), 2));
  found.window = std::ceil(std::max(5.0, n) * tick * 1000) / 1000;
  return found;
}

std::string text_of(const MotionRounding& rounding) {
  return fmt::format(
      "positions are rounded to {:.4g} mm, which makes the velocity jump by {:.2g} mm/s at a feed "
      "of {:.2g} mm/s; --smooth-motion-ms {:.0f} takes that away",
      rounding.step, rounding.velocity_jump, rounding.feed, rounding.window * 1000);
}

}  // namespace toothprep
