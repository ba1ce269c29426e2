#include "toothprep/step/session/replay.h"

#include <algorithm>
#include <chrono>
#include <limits>
#include <string>

#include "toothprep/step/core/errors.h"

namespace toothprep {

namespace {

constexpr double kSameTime = 1e-9;  // s

}  // namespace

PathStepper::PathStepper(const Bur& bur, Workpiece& workpiece, const Parameters& parameters,
                         Drive drive, const std::vector<HandleSample>& path,
                         const Interventions& interventions)
    : bur_(&bur),
      path_(path),
      interventions_(interventions),
      intervals_(workpiece, parameters, drive) {
  if (path.size() < 2) throw Error("a trajectory needs at least two samples");
  if (path.front().rejected) throw Error("the first sample of a trajectory must not be rejected");
}

void PathStepper::refuse(const SessionEvent& event, const char* condition) const {
  throw InputError(
      interventions_.source,
      "/events, " + std::string(name_of(event.kind)) + " at " + std::to_string(event.time) + " s",
      condition, "replay the recording as it was made");
}

// Whether an interval begins.
bool PathStepper::apply(const SessionEvent& event) {
  if (event.kind == EventKind::kEnd) return false;
  if ((event.kind == EventKind::kPause) != (session_ != nullptr))
    refuse(event, session_ ? "the session isn't paused then" : "the session is paused then");
  if (event.kind == EventKind::kUndo && !intervals_.undo())
    refuse(event, "there is nothing to undo");
  if (event.kind == EventKind::kBur) {
    const double at = event.arguments[0];
    if (!(at >= 0 && at < static_cast<double>(interventions_.burs.size())))
      refuse(event, "there is no such bur");
    bur_ = &interventions_.burs[static_cast<std::size_t>(at)];
  }
  if (event.kind == EventKind::kUndo) last_.removed_volume = intervals_.removed_before();
  return event.kind == EventKind::kResume;
}

StepRecord PathStepper::next() {
  const HandleSample& sample = path_[row_];
  const bool last = ++row_ == path_.size();
  bool begins = row_ == 1, pauses = false;
  const auto& events = interventions_.events;
  for (; event_ < events.size() && events[event_].time < sample.time + kSameTime; ++event_) {
    if (events[event_].time < sample.time - kSameTime)
      refuse(events[event_], "the path has no sample of that time");
    pauses = pauses || events[event_].kind == EventKind::kPause;
    begins = apply(events[event_]) || begins;
  }
  if (begins) {
    session_ = &intervals_.begin(*bur_, sample);
    last_ = session_->initial();
  } else if (session_) {
    last_ = session_->step(sample);
  } else {
    StepRecord row;
    row.bur = last_.bur;
    row.removed_volume = last_.removed_volume;
    row.handle = sample;
    return last_ = row;
  }
  if (last || pauses) session_->finish(last_);
  add_removed(intervals_.removed_before(), last_.removed_volume);
  if (pauses) {
    intervals_.end();
    session_ = nullptr;
  }
  return last_;
}

StepRecord PathStepper::end() {
  if (session_) {
    session_->finish(last_);
    add_removed(intervals_.removed_before(), last_.removed_volume);
  }
  row_ = path_.size();
  return last_;
}

ReplayResult replay(const Bur& bur, Workpiece& workpiece, const Parameters& parameters, Drive drive,
                    const std::vector<HandleSample>& path,
                    const std::function<void(double)>& progress,
                    const Interventions& interventions) {
  using Clock = std::chrono::steady_clock;
  PathStepper stepper(bur, workpiece, parameters, drive, path, interventions);
  ReplayResult result;
  result.rows.reserve(path.size());
  result.rows.push_back(stepper.next());
  std::vector<float> step_us;
  step_us.reserve(path.size());
  for (std::size_t i = 1; i < path.size(); ++i) {
    const auto start = Clock::now();
    result.rows.push_back(stepper.next());
    const std::chrono::duration<double, std::micro> us = Clock::now() - start;
    step_us.push_back(static_cast<float>(us.count()));
    result.seconds_computed += us.count() * 1e-6;
    if (progress && i % 1024 == 0)
      progress(static_cast<double>(i) / static_cast<double>(path.size()));
    if (drive == Drive::kLoad && stepper.way_without_contact() > kMostWayWithoutContact) {
      result.ran_off = true;
      result.rows.back() = stepper.end();
      break;
    }
  }

  result.totals = stepper.intervals().totals();
  result.ground = stepper.intervals().ground();
  result.removed_energy = energy_of_removal(parameters, result.totals, result.ground);
  result.energy_ratio = result.removed_energy > 0
                            ? result.totals.torque_work / result.removed_energy
                            : std::numeric_limits<double>::quiet_NaN();
  result.seconds_simulated = result.rows.back().handle.time - path.front().time;
  const auto quantile = [&](std::size_t rank) {
    const auto at = step_us.begin() + static_cast<std::ptrdiff_t>(rank);
    std::nth_element(step_us.begin(), at, step_us.end());
    return *at;
  };
  result.step_us_p50 = quantile(step_us.size() / 2);
  result.step_us_p99 = quantile(step_us.size() * 99 / 100);
  result.step_us_max = quantile(step_us.size() - 1);
  return result;
}

double distance_to_tooth(const std::vector<HandleSample>& path, const Box& box) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const HandleSample& s : path) {
    if (s.rejected) continue;
    const Vec3 outside = (box.min - s.pose.position).cwiseMax(s.pose.position - box.max);
    nearest = std::min(nearest, outside.cwiseMax(0.0).norm());
  }
  return nearest;
}

}  // namespace toothprep
