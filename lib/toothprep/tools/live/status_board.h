// The status of a running loop: written by its servo thread, read by any other.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>

#include "toothprep/step/core/live_tick.h"
#include "toothprep/tools/live/force_governor.h"
#include "toothprep/tools/live/reading_check.h"

namespace toothprep {

// For the status line; each figure is whole, together they may be of two ticks.
struct LiveStatus {
  std::int64_t steps = 0;                         // of the session
  double force = 0;                               // N, commanded
  double lag = 0;                                 // mm, bur behind the handle
  double torque = 0;                              // N·mm
  bool stalled = false, running = false;          // the bur's motor
  PerTissue<double> removed{};                    // mm³
  double heat = 0;                                // of the motors, 1: the continuous limit
  bool vibrates = false;                          // the governor has switched the force off
  double longest_step = 0;                        // s of CPU time
  bool faded = false;                             // the force was ramped out, as it was asked for
  bool locked = false;                            // the motor waits for a safe start
  Vec3 handle = Vec3::Zero();                     // mm, W
  ReadingFault reading = ReadingFault::kNone;     // of the last reading
  ReadingFault last_fault = ReadingFault::kNone;  // of the last one that was rejected
  std::int64_t rejections = 0;                    // how often it began to be
  bool let_go = false;                            // nobody holds the stylus, by its safety switch
  std::int64_t times_let_go = 0;                  // how often that began
  bool hand_lost = false;  // readings were rejected for so long that the session has to end
};

class StatusBoard {  // written by the servo's thread, read by any
 public:
  // Once a tick, on the servo's thread.
  void write(const LiveTick& tick, std::int64_t steps, const ForceGovernor& governor) noexcept {
    steps_.store(steps, kRelaxed);
    force_.store(tick.commanded_force.norm(), kRelaxed);
    lag_.store((tick.row.bur.position - tick.row.handle.pose.position).norm(), kRelaxed);
    torque_.store(tick.row.torque, kRelaxed);
    heat_.store(governor.heat(), kRelaxed);
    for (std::size_t k = 0; k < kTissueCount; ++k)
      removed_[k].store(tick.row.removed_volume[k], kRelaxed);
    stalled_.store(tick.row.stalled, kRelaxed);
    running_.store((tick.row.handle.buttons & kPedalButton) != 0, kRelaxed);
    vibrates_.store(governor.vibrates(), kRelaxed);
    longest_.store(std::max(longest_.load(kRelaxed), tick.step_seconds), kRelaxed);
    faded_.store(governor.faded(), kRelaxed);
    locked_.store((tick.flags & kMotorLocked) != 0, kRelaxed);
    for (std::size_t i = 0; i < 3; ++i)
      handle_[i].store(tick.row.handle.pose.position[static_cast<Eigen::Index>(i)], kRelaxed);
  }

  // What came of a tick's reading.
  void write(ReadingFault reading, bool lost, bool let_go) noexcept {
    if (reading != ReadingFault::kNone) {
      if (reading_.load(kRelaxed) == ReadingFault::kNone)
        rejections_.store(rejections_.load(kRelaxed) + 1, kRelaxed);
      last_fault_.store(reading, kRelaxed);
    }
    reading_.store(reading, kRelaxed);
    lost_.store(lost, kRelaxed);
    if (let_go && !let_go_.load(kRelaxed)) times_let_go_.fetch_add(1, kRelaxed);
    let_go_.store(let_go, kRelaxed);
  }

  [[nodiscard]] LiveStatus read() const noexcept {  // from any thread
    LiveStatus s;
    s.steps = steps_.load(kRelaxed);
    s.force = force_.load(kRelaxed);
    s.lag = lag_.load(kRelaxed);
    s.torque = torque_.load(kRelaxed);
    s.heat = heat_.load(kRelaxed);
    for (std::size_t k = 0; k < kTissueCount; ++k) s.removed[k] = removed_[k].load(kRelaxed);
    s.stalled = stalled_.load(kRelaxed);
    s.running = running_.load(kRelaxed);
    s.vibrates = vibrates_.load(kRelaxed);
    s.longest_step = longest_.load(kRelaxed);
    s.faded = faded_.load(kRelaxed);
    s.locked = locked_.load(kRelaxed);
    for (std::size_t i = 0; i < 3; ++i)
      s.handle[static_cast<Eigen::Index>(i)] = handle_[i].load(kRelaxed);
    s.reading = reading_.load(kRelaxed);
    s.last_fault = last_fault_.load(kRelaxed);
    s.rejections = rejections_.load(kRelaxed);
    s.hand_lost = lost_.load(kRelaxed);
    s.let_go = let_go_.load(kRelaxed);
    s.times_let_go = times_let_go_.load(kRelaxed);
    return s;
  }

 private:
  static constexpr auto kRelaxed = std::memory_order_relaxed;
  std::atomic<std::int64_t> steps_ = 0;
  std::atomic<double> force_ = 0, lag_ = 0, torque_ = 0, heat_ = 0, longest_ = 0;
  std::array<std::atomic<double>, kTissueCount> removed_{};
  std::atomic<bool> stalled_ = false, running_ = false, vibrates_ = false;
  std::atomic<bool> faded_ = false, locked_ = false, lost_ = false, let_go_ = false;
  std::atomic<std::int64_t> times_let_go_ = 0;
  std::array<std::atomic<double>, 3> handle_{};
  std::atomic<ReadingFault> reading_ = ReadingFault::kNone, last_fault_ = ReadingFault::kNone;
  std::atomic<std::int64_t> rejections_ = 0;
};

}  // namespace toothprep
