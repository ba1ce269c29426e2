// Figures of the ticks for the end of a session, gathered on the servo's thread in fixed memory.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "toothprep/step/core/live_tick.h"

namespace toothprep {

// Counts in steps of a microsecond.
class Microseconds {
 public:
  void add(double seconds) noexcept {  // one entry
    const double us = 1e6 * seconds;
    ++counts_[static_cast<std::size_t>(std::clamp(us, 0.0, kBins - 1.0))];
    ++total_;
    worst_ = std::max(worst_, us);
  }
  // The value below which this share of the entries lies, to a microsecond upwards; us.
  [[nodiscard]] double quantile(double share) const noexcept {
    const auto wanted = static_cast<std::int64_t>(share * static_cast<double>(total_));
    std::int64_t seen = 0;
    for (std::size_t b = 0; b < counts_.size(); ++b) {
      seen += counts_[b];
      if (seen > wanted) return std::min(static_cast<double>(b + 1), worst_);
    }
    return worst_;
  }
  double worst() const noexcept { return worst_; }        // us
  std::int64_t total() const noexcept { return total_; }  // entries

 private:
  static constexpr int kBins = 10000;  // 10 ms
  std::array<std::int64_t, kBins> counts_{};
  std::int64_t total_ = 0;
  double worst_ = 0;
};

struct TickStatistics {  // over a whole run
  // Of the ticks that were due.
  double missed_share() const noexcept {
    return ticks > 0 ? static_cast<double>(missed) / static_cast<double>(ticks + missed) : 0;
  }

  Microseconds step, period;           // CPU time of a tick; between ticks
  std::int64_t ticks = 0, missed = 0;  // counts
  std::int64_t clamped = 0, rate_limited = 0, heat_limited = 0, rejected = 0;  // of these
  double last_time = 0;                                                        // s

  void add(const LiveTick& tick) noexcept {  // one tick
    step.add(tick.step_seconds);
    if (ticks > 0) {
      period.add(tick.servo_time - last_time);
      missed += tick.missed;
    }
    last_time = tick.servo_time;
    ++ticks;
    clamped += (tick.flags & kForceClamped) != 0;
    rate_limited += (tick.flags & kForceRateLimited) != 0;
    heat_limited += (tick.flags & kForceHeatLimited) != 0;
    rejected += (tick.flags & kReadingRejected) != 0;
  }
};

}  // namespace toothprep
