#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/memory_limit.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {
namespace {

constexpr double kSameTime = 1e-9;   // s
constexpr double kLargestGap = 0.1;  // s

std::string seconds(double t) {
  std::string text = std::to_string(t);
  return text + " s";
}

HandleSample between(const HandleSample& a, const HandleSample& b, double time) {
  const double fraction = std::clamp((time - a.time) / (b.time - a.time), 0.0, 1.0);
  HandleSample result;
  result.time = time;
  result.pose.position = (1.0 - fraction) * a.pose.position + fraction * b.pose.position;
  // Nothing turned: keep the very bits (slerp of equals may change the last one).
  result.pose.orientation =
      a.pose.orientation.coeffs() == b.pose.orientation.coeffs()
          ? a.pose.orientation
          : a.pose.orientation.slerp(fraction, b.pose.orientation).normalized();
  result.buttons = a.buttons;
  result.load = (1.0 - fraction) * a.load + fraction * b.load;
  return result;
}

// No hand is recorded at less than 10 Hz.
bool mostly_gaps(const std::vector<HandleSample>& in) {
  std::size_t gaps = 0;
  for (std::size_t j = 1; j < in.size(); ++j) gaps += in[j].time - in[j - 1].time > kLargestGap;
  return gaps > in.size() / 2;
}

// How many samples there are at the step rate.
std::size_t resampled_size(const Trajectory& trajectory, double time_step,
                           const std::string& where) {
  const std::vector<HandleSample>& in = trajectory.samples;
  if (!(time_step > 0) || !std::isfinite(time_step))
    throw Error("the step of a resampling must be positive and finite");
  if (in.size() < 2) throw InputError(where, "", "holds fewer than two samples", "record a motion");
  const double duration = in.back().time - in.front().time;
  const double steps = std::floor((duration + kSameTime) / time_step);
  if (!(steps < static_cast<double>(kMostSamples)))
    throw InputError(where, "",
                     "lasts " + seconds(duration) + ", more than " + std::to_string(kMostSamples) +
                         " steps of " + seconds(time_step),
                     "cut it into pieces");
  return static_cast<std::size_t>(steps) + 1;
}

}  // namespace

bool accept_quaternion(const Quat& recorded, Quat& orientation) {
  const double length = recorded.norm();
  if (!(std::abs(length - 1.0) <= 1e-3)) return false;
  orientation = std::abs(length - 1.0) > 1e-12 ? recorded.normalized() : recorded;
  return true;
}

std::vector<HandleSample> resample(const Trajectory& trajectory, double time_step, bool allow_gaps,
                                   const std::string& where) {
  const std::vector<HandleSample>& in = trajectory.samples;
  for (std::size_t j = 0; j + 1 < in.size(); ++j) {
    const double gap = in[j + 1].time - in[j].time;
    if (!(gap > 0))
      throw InputError(where, "time " + seconds(in[j + 1].time), "time does not increase");
    if (gap > kLargestGap + kSameTime && !allow_gaps)
      throw InputError(where, "time " + seconds(in[j].time),
                       "a gap of " + seconds(gap) + " follows, more than 0.1 s",
                       mostly_gaps(in) ? "are these milliseconds? times are in seconds"
                                       : "record without gaps, or allow them (--allow-gaps)");
  }

  const std::size_t count = resampled_size(trajectory, time_step, where);
  const double start = in.front().time;
  const auto time_of = [&](std::size_t i) { return start + static_cast<double>(i) * time_step; };
  bool on_grid = count == in.size();
  for (std::size_t i = 0; on_grid && i < count; ++i)
    on_grid = std::abs(in[i].time - time_of(i)) <= kSameTime;
  if (on_grid) return in;
  if (any_rejected(trajectory))
    return resample(without_rejected(trajectory), time_step, allow_gaps, where);

  std::vector<HandleSample> out;
  out.reserve(count);
  std::size_t j = 0;  // the latest sample at or before the time
  for (std::size_t i = 0; i < count; ++i) {
    const double time = time_of(i);
    while (j + 1 < in.size() && in[j + 1].time <= time + kSameTime) ++j;
    if (j + 1 == in.size() || std::abs(in[j].time - time) <= kSameTime) {
      out.push_back(in[j]);
      out.back().time = time;
    } else {
      out.push_back(between(in[j], in[j + 1], time));
    }
  }
  return out;
}

bool any_rejected(const Trajectory& trajectory) {
  return std::any_of(trajectory.samples.begin(), trajectory.samples.end(),
                     [](const HandleSample& s) { return s.rejected; });
}

Trajectory without_rejected(const Trajectory& trajectory) {
  Trajectory good;
  good.loaded = trajectory.loaded;
  for (std::size_t i = 0; i < trajectory.samples.size(); ++i) {
    if (trajectory.samples[i].rejected) continue;
    good.samples.push_back(trajectory.samples[i]);
    if (!trajectory.measured_force.empty())
      good.measured_force.push_back(trajectory.measured_force[i]);
  }
  return good;
}

void check_run_memory(const std::string& path, const Trajectory& motion, double time_step) {
  if (motion.samples.empty()) return;
  const double steps =
      std::floor((motion.samples.back().time - motion.samples.front().time) / time_step);
  if (steps > static_cast<double>(kMostSamples)) return;  // resample() refuses it
  // The motion at the step rate, the rows, and what writes them.
  const double bytes = steps * (sizeof(HandleSample) + sizeof(StepRecord) + 8 * sizeof(double));
  const auto free = static_cast<double>(available_memory());
  if (bytes > free)
    throw InputError(path, "",
                     fmt::format("makes {:.0f} steps, which take {} of memory where {} are free",
                                 steps, size_text(bytes), size_text(free)),
                     "cut the recording into pieces, or take a longer --time-step-s");
}

}  // namespace toothprep
