#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "toothprep/step/core/statistics.h"
#include "toothprep/tools/recordings/raw_motion.h"

namespace toothprep {
namespace {

constexpr double kMostProducts = 4e8;  // of samples and lags
constexpr int kParts = 8;
constexpr double kFinest = 0.001;      // s
constexpr double kSlow = 0.3;          // s
constexpr double kSearchAgain = 0.25;  // s round the coarse peak

// Values at start + i step, linear between samples; zero beyond them.
std::vector<Vec3> even(const std::vector<double>& time, const std::vector<Vec3>& value,
                       double start, double step, std::size_t count) {
  std::vector<Vec3> out(count, Vec3::Zero());
  std::size_t j = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double t = start + static_cast<double>(i) * step;
    while (j + 1 < time.size() && time[j + 1] <= t) ++j;
    if (t < time.front() || j + 1 >= time.size()) continue;
    const double part = (t - time[j]) / (time[j + 1] - time[j]);
    out[i] = (1 - part) * value[j] + part * value[j + 1];
  }
  return out;
}

// Velocities over `window` seconds.
std::vector<Vec3> velocities(const std::vector<Vec3>& position, double step, double window) {
  const auto half = std::max<std::size_t>(1, static_cast<std::size_t>(window / step / 2));
  std::vector<Vec3> v(position.size(), Vec3::Zero());
  for (std::size_t i = half; i + half < position.size(); ++i)
    v[i] = (position[i + half] - position[i - half]) / (2 * static_cast<double>(half) * step);
  return v;
}

// What changes within kSlow: the mean over that window taken off. A feed's slow changes are alike
// at many lags; a hand's tremor, starts and turns are not.
void high_pass(std::vector<Vec3>& values, double step) {
  const auto half = static_cast<std::size_t>(kSlow / step / 2);
  std::vector<Vec3> sums(values.size() + 1, Vec3::Zero());
  for (std::size_t i = 0; i < values.size(); ++i) sums[i + 1] = sums[i] + values[i];
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::size_t first = i > half ? i - half : 0, last = std::min(values.size(), i + half + 1);
    values[i] -= (sums[last] - sums[first]) / static_cast<double>(last - first);
  }
}

// Evenly sampled velocity and force, and the range of lags between them in samples.
struct Signals {
  std::vector<Vec3> velocity, force;
  std::ptrdiff_t first_lag = 0, last_lag = 0;
};

// Norms of the sums of velocity x force by lag, over all samples but those of one part (-1: none).
std::vector<double> norms(const Signals& s, int left_out) {
  std::vector<double> norm;
  const auto n = static_cast<std::ptrdiff_t>(s.velocity.size());
  const auto m = static_cast<std::ptrdiff_t>(s.force.size());
  for (std::ptrdiff_t lag = s.first_lag; lag <= s.last_lag; ++lag) {
    Mat3 sum = Mat3::Zero();
    for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(0, -lag); i < n && i + lag < m; ++i) {
      if (i * kParts / n == left_out) continue;
      sum += s.velocity[static_cast<std::size_t>(i)] *
             s.force[static_cast<std::size_t>(i + lag)].transpose();
    }
    norm.push_back(sum.norm());
  }
  return norm;
}

// The peak's place in samples, between them by a parabola.
double peak(const std::vector<double>& norm) {
  const auto top =
      static_cast<std::size_t>(std::max_element(norm.begin(), norm.end()) - norm.begin());
  if (top == 0 || top + 1 == norm.size()) return static_cast<double>(top);
  const double a = norm[top - 1], b = norm[top], c = norm[top + 1];
  const double bend = a - 2 * b + c;
  return static_cast<double>(top) + (bend < 0 ? 0.5 * (a - c) / bend : 0);
}

Signals signals(const RawMotion& motion, const RawForce& force, double step) {
  const auto count = [step](const std::vector<double>& time) {
    return static_cast<std::size_t>((time.back() - time.front()) / step) + 1;
  };
  Signals s;
  s.velocity =
      velocities(even(motion.time, motion.position, motion.time.front(), step, count(motion.time)),
                 step, 0.02);
  s.force = even(force.time, force.force, force.time.front(), step, count(force.time));
  high_pass(s.velocity, step);
  high_pass(s.force, step);
  return s;
}

}  // namespace

ClockOffset clock_offset(const RawMotion& motion, const RawForce& force) {
  const double span = motion.time.back() - motion.time.front();
  const double force_span = force.time.back() - force.time.front();
  // First coarsely over all lags at which half of the shorter one overlaps, then finely round that.
  const double half = 0.5 * std::min(span, force_span);
  double step = std::max(kFinest, std::sqrt(span * (span + force_span - 2 * half) / kMostProducts));
  Signals s = signals(motion, force, step);
  s.first_lag = -static_cast<std::ptrdiff_t>((span - half) / step);
  s.last_lag = static_cast<std::ptrdiff_t>((force_span - half) / step);
  const std::vector<double> coarse = norms(s, -1);
  ClockOffset result;
  const double top = *std::max_element(coarse.begin(), coarse.end());
  result.prominence = top / std::max(median(coarse), 1e-300);
  const double about = (peak(coarse) + static_cast<double>(s.first_lag)) * step;

  step = kFinest;
  s = signals(motion, force, step);
  s.first_lag = static_cast<std::ptrdiff_t>((about - kSearchAgain) / step);
  s.last_lag = static_cast<std::ptrdiff_t>((about + kSearchAgain) / step);
  const auto lag_without = [&](int part) {
    return (peak(norms(s, part)) + static_cast<double>(s.first_lag)) * step;
  };
  const double lag = lag_without(-1);
  double squares = 0;
  for (int part = 0; part < kParts; ++part) squares += std::pow(lag_without(part) - lag, 2);
  // And what lies between two samples, which no part of the recording can show.
  const auto spacing = [](const std::vector<double>& time) {
    return (time.back() - time.front()) / static_cast<double>(time.size() - 1);
  };
  const double between = std::hypot(spacing(motion.time), spacing(force.time)) / std::sqrt(12.0);
  result.std = std::hypot(std::sqrt(squares * (kParts - 1) / kParts), between);
  // A lag is counted from the beginnings of both.
  result.delay = lag + force.time.front() - motion.time.front();
  return result;
}

void attach_force(RawMotion& motion, const RawForce& force, double delay,
                  ImportedRecording& report) {
  std::vector<char> keep(motion.size(), 0);
  motion.force.assign(motion.size(), Vec3::Zero());
  std::size_t kept = 0;
  for (std::size_t i = 0; i < motion.size(); ++i) {
    const double t = motion.time[i] + delay;
    if (t < force.time.front() || t > force.time.back()) continue;
    const double before = i > 0 ? (motion.time[i] - motion.time[i - 1]) / 2 : 0;
    const double after = i + 1 < motion.size() ? (motion.time[i + 1] - motion.time[i]) / 2 : 0;
    const auto first = std::lower_bound(force.time.begin(), force.time.end(), t - before);
    const auto last = std::upper_bound(force.time.begin(), force.time.end(), t + after);
    const auto at = [&](auto it) {
      return force.force[static_cast<std::size_t>(it - force.time.begin())];
    };
    if (last - first >= 3) {
      Vec3 sum = Vec3::Zero();
      for (auto it = first; it != last; ++it) sum += at(it);
      motion.force[i] = sum / static_cast<double>(last - first);
    } else {
      const auto next =
          std::min(std::upper_bound(force.time.begin(), force.time.end(), t), force.time.end() - 1);
      const auto previous = next == force.time.begin() ? next : next - 1;
      const double between = *next - *previous;
      const double part = between > 0 ? std::clamp((t - *previous) / between, 0.0, 1.0) : 0;
      motion.force[i] = (1 - part) * at(previous) + part * at(next);
    }
    keep[i] = 1;
    ++kept;
  }
  if (kept < motion.size())
    report.warnings.push_back(
        fmt::format("{} of {} samples of the motion have no force, and are left out",
                    motion.size() - kept, motion.size()));
  motion.select(keep);
}

}  // namespace toothprep
