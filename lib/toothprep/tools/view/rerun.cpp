#include "toothprep/tools/view/rerun.h"

#include <algorithm>
#include <exception>

#include "toothprep/step/session/replay.h"

namespace toothprep {
namespace {

constexpr double kFinest = 0.05;            // s between frames, at least
constexpr std::size_t kManyFrames = 2000;   // of a long session
constexpr std::size_t kMuchMemory = 256e6;  // bytes, after each of which frames are twice as rare
constexpr std::size_t kReportEvery = 1000;  // steps

}  // namespace

Rerun::Rerun(const Recording& recording, const LayeredTooth& tooth)
    : recording_(recording), workpiece_(tooth), frames_(workpiece_), frame_rows_{0} {
  worker_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

void Rerun::run(const std::stop_token& stop) {
  std::string failure;
  try {
    step_all(stop);
  } catch (const std::exception& e) {
    failure = e.what();
  }
  const std::lock_guard lock(guard_);
  progress_.finished = true;
  progress_.failure = failure;
}

void Rerun::add_frame(std::size_t row) {
  frames_.add(workpiece_);
  const std::lock_guard lock(guard_);
  frame_rows_.push_back(row);
}

void Rerun::step_all(const std::stop_token& stop) {
  const std::vector<HandleSample>& path = recording_.path;
  const std::vector<StepRecord>& rows = recording_.rows;
  const Parameters& parameters = recording_.parameters;
  const auto finest = static_cast<std::size_t>(kFinest / parameters.time_step);
  const std::size_t rare = std::max({std::size_t{1}, finest, path.size() / kManyFrames});
  PathStepper stepper(recording_.bur, workpiece_, parameters, recording_.drive, path,
                      recording_.interventions);
  static_cast<void>(stepper.next());
  add_frame(0);  // without what lay inside the bur at first
  double bur_difference = 0, force_difference = 0;
  std::size_t next = rare;
  for (std::size_t i = 1; i < path.size() && !stop.stop_requested(); ++i) {
    const bool last = i + 1 == path.size();
    const StepRecord row = stepper.next();
    bur_difference = std::max(bur_difference, (row.bur.position - rows[i].bur.position).norm());
    force_difference = std::max(force_difference, (row.device_force - rows[i].device_force).norm());
    if (i == next || last) {
      add_frame(i);
      next = i + (rare << (frames_.bytes() / kMuchMemory));
    }
    if (i % kReportEvery && !last) continue;
    const std::lock_guard lock(guard_);
    progress_.done = static_cast<double>(i + 1) / static_cast<double>(path.size());
    progress_.bur_difference = bur_difference;
    progress_.force_difference = force_difference;
  }
}

Rerun::Progress Rerun::progress(std::size_t from) const {
  const std::lock_guard lock(guard_);
  Progress progress = progress_;
  if (from < frame_rows_.size())
    progress.frame_rows.assign(frame_rows_.begin() + static_cast<std::ptrdiff_t>(from),
                               frame_rows_.end());
  return progress;
}

}  // namespace toothprep
