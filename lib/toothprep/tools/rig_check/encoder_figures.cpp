// Encoders: resolution and noise at rest.
#include <algorithm>
#include <cmath>

#include "toothprep/step/core/statistics.h"
#include "toothprep/tools/rig_check/protocol.h"
#include "toothprep/tools/rig_check/rig_figures.h"

namespace toothprep {
namespace {

using Window = std::pair<std::size_t, std::size_t>;

// Residuals of one axis about the straight line of least squares.
std::vector<double> about_a_line(const SessionRecording& r, const Window& w, int axis) {
  const auto n = static_cast<double>(w.second - w.first);
  const double middle = 0.5 * (n - 1);
  double mean = 0, slope = 0, spread = 0;
  for (std::size_t i = w.first; i < w.second; ++i) mean += r.device_position[i][axis] / n;
  for (std::size_t i = w.first; i < w.second; ++i) {
    const double t = static_cast<double>(i - w.first) - middle;
    slope += t * (r.device_position[i][axis] - mean);
    spread += t * t;
  }
  slope /= spread;
  std::vector<double> residual;
  residual.reserve(w.second - w.first);
  for (std::size_t i = w.first; i < w.second; ++i)
    residual.push_back(r.device_position[i][axis] - mean -
                       slope * (static_cast<double>(i - w.first) - middle));
  return residual;
}

bool rests(const SessionRecording& r, const Window& w, const RigMethod& method) {
  const std::size_t quarter = (w.second - w.first) / 4;
  std::array<Vec3, 4> mean;
  for (std::size_t q = 0; q < 4; ++q) {
    mean[q].setZero();
    for (std::size_t i = 0; i < quarter; ++i)
      mean[q] += r.device_position[w.first + q * quarter + i] / static_cast<double>(quarter);
  }
  for (std::size_t a = 0; a < 4; ++a)
    for (std::size_t b = 0; b < a; ++b)
      if ((mean[a] - mean[b]).cwiseAbs().maxCoeff() > method.rest_drift_mm) return false;
  for (std::size_t i = w.first; i < w.second; ++i)
    if (r.force_sent[i].norm() > method.rest_force_n || r.flags[i] & kHandleHeld) return false;
  for (int axis = 0; axis < 3; ++axis) {
    double sum = 0;
    for (const double e : about_a_line(r, w, axis)) sum += e * e;
    if (std::sqrt(sum / static_cast<double>(w.second - w.first)) > method.rest_noise_mm)
      return false;
  }
  return true;
}

// Sorts `values`; the gaps between those that differ.
std::vector<double> gaps_between_distinct(std::vector<double>& values) {
  std::sort(values.begin(), values.end());
  std::vector<double> gaps;
  for (std::size_t i = 1; i < values.size(); ++i)
    if (values[i] - values[i - 1] > kSameReading) gaps.push_back(values[i] - values[i - 1]);
  return gaps;
}

}  // namespace

std::vector<Window> rest_windows(const SessionRecording& r, const RigMethod& method) {
  const auto length =
      static_cast<std::size_t>(std::lround(method.rest_window_s * r.header.rate_hz));
  const bool all_rest = r.header.protocol.rfind(name_of(ProtocolKind::kRest), 0) == 0;
  std::vector<Window> windows;
  if (length < 8) return windows;
  for (std::size_t begin = 0; begin + length <= r.tick.size();) {
    const Window w(begin, begin + length);
    std::size_t gap = 0;  // the last row in it before which rows lack
    for (std::size_t i = w.first + 1; i < w.second; ++i)
      if (r.tick[i] != r.tick[i - 1] + 1) gap = i;
    if (gap > 0) {
      begin = gap;
    } else if (all_rest || rests(r, w, method)) {
      windows.push_back(w);
      begin += length;
    } else {
      begin += length / 4;
    }
  }
  return windows;
}

Measured<QuantumFigures> quantum_figures(const SessionRecording& r, const RigMethod& method) {
  const std::vector<Window> windows = rest_windows(r, method);
  QuantumFigures f;
  f.at_rest = true;
  for (int axis = 0; axis < 3; ++axis) {
    // Window by window: a real arm's grid is another one elsewhere.
    std::vector<double> gaps;
    for (const Window& w : windows) {
      std::vector<double> readings;
      for (std::size_t i = w.first; i < w.second; ++i)
        readings.push_back(r.device_position[i][axis]);
      for (const double gap : gaps_between_distinct(readings)) gaps.push_back(gap);
    }
    if (!gaps.empty()) f.axis[static_cast<std::size_t>(axis)] = quantile(gaps, 0.25);
  }
  f.largest = *std::max_element(f.axis.begin(), f.axis.end());
  if (f.largest > 0) return f;

  f.at_rest = false;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> differences;
    for (std::size_t i = 1; i < r.device_position.size(); ++i) {
      const double d = std::abs(r.device_position[i][axis] - r.device_position[i - 1][axis]);
      if (d > kSameReading && r.tick[i] == r.tick[i - 1] + 1) differences.push_back(d);
    }
    if (differences.size() >= 20)
      f.axis[static_cast<std::size_t>(axis)] = quantile(differences, 0.05);
  }
  f.largest = *std::max_element(f.axis.begin(), f.axis.end());
  if (!(f.largest > 0)) return Measured<QuantumFigures>::no("the device's reading never changed");
  return f;
}

Measured<RestFigures> rest_figures(const SessionRecording& r, const RigMethod& method) {
  const std::vector<Window> windows = rest_windows(r, method);
  if (windows.empty())
    return Measured<RestFigures>::no(
        "the handle never rested; lay the handle down for a second, or record the protocol rest");
  RestFigures f;
  double samples = 0, differences = 0;
  for (const Window& w : windows) {
    samples += static_cast<double>(w.second - w.first);
    differences += static_cast<double>(w.second - w.first - 1);
  }
  const double rate = r.header.rate_hz;
  for (int axis = 0; axis < 3; ++axis) {
    double noise = 0, velocity = 0;
    for (const Window& w : windows) {
      for (const double e : about_a_line(r, w, axis)) noise += e * e;
      for (std::size_t i = w.first + 1; i < w.second; ++i) {
        const double v = (r.device_position[i][axis] - r.device_position[i - 1][axis]) * rate;
        velocity += v * v;
      }
    }
    f.noise[static_cast<std::size_t>(axis)] = std::sqrt(noise / samples);
    f.velocity_noise[static_cast<std::size_t>(axis)] = std::sqrt(velocity / differences);
  }
  f.seconds = samples / rate;
  const std::size_t worst =
      static_cast<std::size_t>(std::max_element(f.noise.begin(), f.noise.end()) - f.noise.begin());
  f.worst_noise = f.noise[worst];
  f.worst_velocity_noise = *std::max_element(f.velocity_noise.begin(), f.velocity_noise.end());
  const Measured<QuantumFigures> quantum = quantum_figures(r, method);
  const double count = quantum ? quantum->axis[worst] : 0;
  f.noise_above_quantum =
      std::sqrt(std::max(0.0, f.worst_noise * f.worst_noise - count * count / 12));
  return f;
}

}  // namespace toothprep
