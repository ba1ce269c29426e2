// The servo tick of an active check: no tooth, only a law from place to force, such as a spring or
// a wall, with the same limits and the same record as a session's.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>

#include "toothprep/tools/live/live_loop.h"
#include "toothprep/tools/live/live_watch.h"

namespace toothprep {

// Time since the first tick (s, by the clock of n T), place of the handle and its step since the
// last tick (mm, D) to a force (N, D). Called on the servo's thread: it must not throw, allocate
// or lock.
using ForceLaw = std::function<Vec3(double time, const Vec3& place, const Vec3& step)>;

class ProbeLoop final : public ServoClient {
 public:
  // Throws Error as ForceGovernor and ReadingCheck do. `sink` may be nullptr.
  ProbeLoop(const ForceLimits& limits, ForceLaw law, TickSink* sink,
            const ReadingLimits& readings = {}, bool safety_switch = true);

  // A row's handle and bur are the device's pose (W = D), its forces the law's. A reading that
  // can't be true is no place for the law, and no force.
  Vec3 tick(const DeviceReading& reading) override;

  // As LiveLoop::fade_out().
  void fade_out(bool wanted) noexcept { fade_wanted_.store(wanted, std::memory_order_relaxed); }

  LiveStatus status() const noexcept { return status_.read(); }

 private:
  ForceGovernor governor_;
  ReadingCheck check_;
  ForceLaw law_;
  TickSink* sink_;
  double period_;
  bool safety_switch_;
  std::atomic<bool> fade_wanted_ = false;
  std::int64_t steps_ = 0;
  Vec3 last_place_ = Vec3::Zero();
  StatusBoard status_;
};

// An active check: starts the device, watches and ends as run_live() does.
LiveEnd run_probe(HapticDevice& device, ProbeLoop& loop, const LiveWatch& watch);

}  // namespace toothprep
