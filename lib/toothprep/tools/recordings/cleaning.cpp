#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "toothprep/step/core/statistics.h"
#include "toothprep/tools/recordings/raw_motion.h"
#include "toothprep/tools/recordings/rounding.h"

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

void note_rounding(const RawMotion& m, const ImportSettings& s, ImportedRecording& report) {
  const std::optional<MotionRounding> rounding = rounding_of(m.time, m.position);
  if (!rounding) return;
  report.figures.position_step_mm = rounding->step;
  if (rounding->matters() && s.smooth_s == 0) report.warnings.push_back(text_of(*rounding));
}

}  // namespace

void clean(RawMotion& motion, const ImportSettings& s, ImportedRecording& report) {
  clean_spikes(motion, s, report);
  clean_held(motion, s, report);
  note_rounding(motion, s, report);
}

}  // namespace toothprep
