#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "toothprep/step/core/statistics.h"
#include "toothprep/tools/recordings/raw_motion.h"

namespace toothprep {
namespace {

constexpr double kLongestHold = 0.2;     // s; a bur at rest repeats its pose longer
constexpr double kHeldShare = 0.3;       // of the moving samples, above which the tracker is slower
constexpr double kEvenness = 0.5;        // of the runs' lengths: deviation over mean
constexpr double kLeastSpike = 0.05;     // mm
constexpr double kSpikeOverMotion = 12;  // of the median distance from the neighbours' median
constexpr std::size_t kLongestSpike = 3;

bool same_pose(const RawMotion& m, std::size_t a, std::size_t b) {
  return m.position[a] == m.position[b] &&
         (m.orientation.empty() || m.orientation[a].coeffs() == m.orientation[b].coeffs());
}

// Lengths of the runs of equal poses that are no rest, of more than one sample or not.
std::vector<std::size_t> short_runs(const RawMotion& m) {
  std::vector<std::size_t> runs;
  std::size_t start = 0;
  for (std::size_t i = 1; i <= m.size(); ++i) {
    if (i < m.size() && same_pose(m, i, start)) continue;
    if (m.time[i - 1] - m.time[start] < kLongestHold) runs.push_back(i - start);
    start = i;
  }
  return runs;
}

// A tracker that is slower than the log repeats each pose about as often.
bool is_held(const std::vector<std::size_t>& runs, double& mean) {
  double n = 0, sum = 0, squares = 0;
  for (const std::size_t run : runs) {
    n += 1;
    sum += static_cast<double>(run);
    squares += static_cast<double>(run) * static_cast<double>(run);
  }
  if (n < 3) return false;
  mean = sum / n;
  const double deviation = std::sqrt(std::max(0.0, squares / n - mean * mean));
  return (sum - n) / sum > kHeldShare && deviation < kEvenness * mean;
}

// In place of repeated poses, poses on the way to the next new one. The last of a recording stay.
void release_held(RawMotion& m) {
  std::size_t start = 0;
  for (std::size_t i = 1; i < m.size(); ++i) {
    if (same_pose(m, i, start)) continue;
    const double span = m.time[i] - m.time[start];
    if (span < 2 * kLongestHold)
      for (std::size_t j = start + 1; j < i; ++j) {
        const double part = (m.time[j] - m.time[start]) / span;
        m.position[j] = (1 - part) * m.position[start] + part * m.position[i];
        if (!m.orientation.empty())
          m.orientation[j] = m.orientation[start].slerp(part, m.orientation[i]);
      }
    start = i;
  }
}

void clean_held(RawMotion& m, const ImportSettings& s, ImportedRecording& report) {
  double mean = 0;
  const std::vector<std::size_t> runs = short_runs(m);
  if (!is_held(runs, mean)) return;
  for (const std::size_t run : runs) report.figures.held += run - 1;
  const std::string what = fmt::format(
      "each pose stands {:.1f} times in a row: the tracker is slower than the recording", mean);
  if (s.keep_held) {
    report.warnings.push_back(what + "; kept, so the bur moves by leaps");
  } else {
    report.notes.push_back(what + "; poses between are interpolated (--keep-held keeps them)");
    release_held(m);
  }
}

// Distance of each position from the median of the seven round it.
std::vector<double> distances_from_neighbours(const RawMotion& m) {
  std::vector<double> distance(m.size(), 0);
  for (std::size_t i = 3; i + 3 < m.size(); ++i) {
    Vec3 middle;
    for (int axis = 0; axis < 3; ++axis) {
      std::array<double, 7> near{};
      for (std::size_t j = 0; j < 7; ++j) near[j] = m.position[i + j - 3][axis];
      std::nth_element(near.begin(), near.begin() + 3, near.end());
      middle[axis] = near[3];
    }
    distance[i] = (m.position[i] - middle).norm();
  }
  return distance;
}

void clean_spikes(RawMotion& m, const ImportSettings& s, ImportedRecording& report) {
  if (m.size() < 20) return;
  const std::vector<double> distance = distances_from_neighbours(m);
  const double most = std::max(kLeastSpike, kSpikeOverMotion * median(distance));
  double largest = 0, first = 0;
  for (std::size_t i = 3; i + 3 < m.size(); ++i) {
    if (!(distance[i] > most)) continue;
    std::size_t end = i;
    while (end < m.size() && distance[end] > most) ++end;
    if (end - i <= kLongestSpike && end < m.size()) {
      if (report.figures.spikes == 0) first = m.time[i];
      report.figures.spikes += end - i;
      for (std::size_t j = i; j < end; ++j) {
        largest = std::max(largest, distance[j]);
        if (!s.despike) continue;
        const double part = (m.time[j] - m.time[i - 1]) / (m.time[end] - m.time[i - 1]);
        m.position[j] = (1 - part) * m.position[i - 1] + part * m.position[end];
        if (!m.orientation.empty())
          m.orientation[j] = m.orientation[i - 1].slerp(part, m.orientation[end]);
      }
    }
    i = end;
  }
  if (report.figures.spikes == 0) return;
  const std::string what =
      fmt::format("{} positions jump away and back, by up to {:.3g} mm, first at {:.3f} s",
                  report.figures.spikes, largest, first);
  if (s.despike)
    report.notes.push_back(what + "; interpolated");
  else
    report.warnings.push_back(what + "; --despike interpolates them");
}

// The step of which all differences are multiples; 0 if there is none.
double rounding_step(const RawMotion& m) {
  double step = 0;
  std::size_t steps = 0;
  for (int axis = 0; axis < 3; ++axis)
    for (std::size_t i = 1; i < m.size(); ++i) {
      const double d = std::abs(m.position[i][axis] - m.position[i - 1][axis]);
      if (d > 1e-9 && (step == 0 || d < step)) step = d;
    }
  if (!(step > 0)) return 0;
  for (int axis = 0; axis < 3; ++axis)
    for (std::size_t i = 1; i < m.size(); ++i) {
      const double multiple = std::abs(m.position[i][axis] - m.position[i - 1][axis]) / step;
      if (std::abs(multiple - std::round(multiple)) > 0.02 + 1e-6 * multiple) return 0;
      steps += multiple > 1.5;
    }
  return steps > 10 ? step : 0;  // a feed of constant steps is no rounding
}

// Rounded positions make the velocity jump, and the force goes with it.
void note_rounding(const RawMotion& m, const ImportSettings& s, ImportedRecording& report) {
  report.figures.position_step_mm = rounding_step(m);
  const double step = report.figures.position_step_mm;
  if (step == 0 || s.smooth_s > 0) return;
  std::vector<double> speed, dt;
  const std::size_t apart = std::max<std::size_t>(1, m.size() / 2000);
  for (std::size_t i = 1; i < m.size(); ++i) dt.push_back(m.time[i] - m.time[i - 1]);
  const double tick = median(std::move(dt));
  const auto wide = static_cast<std::size_t>(std::max(1.0, 0.05 / tick));
  for (std::size_t i = wide; i < m.size(); i += apart) {
    const double v = (m.position[i] - m.position[i - wide]).norm() / (m.time[i] - m.time[i - wide]);
    if (v > 0.01) speed.push_back(v);
  }
  if (speed.empty()) return;
  const double feed = median(std::move(speed)), noise = step / std::sqrt(6.0) / tick;
  if (noise < 0.03 * feed) return;
  // A local quadratic over n samples leaves sqrt(12 / n^3) of the noise of a position in a velocity.
  const double n = std::cbrt(12 * std::pow(step / std::sqrt(12.0) / tick / (0.03 * feed), 2));
  report.warnings.push_back(
      fmt::format("positions are rounded to {:.4g} mm, which makes the velocity jump by {:.2g} "
                  "mm/s at a feed of "
                  "{:.2g} mm/s; --smooth-motion-ms {:.0f} takes that away",
                  step, noise, feed, std::ceil(std::max(5.0, n) * tick * 1000)));
}

}  // namespace

void clean(RawMotion& motion, const ImportSettings& s, ImportedRecording& report) {
  clean_spikes(motion, s, report);
  clean_held(motion, s, report);
  note_rounding(motion, s, report);
}

}  // namespace toothprep
