// The servo tick of an active check: no tooth, only a law from place to force, such as a spring or
// a wall, with the same limits and the same record as a session's.
#pragma once

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
  // Throws Error as ForceGovernor does. `sink` may be nullptr.
  ProbeLoop(const ForceLimits& limits, ForceLaw law, TickSink* sink);

  // A row's handle and bur are the device's pose (W = D), its forces the law's.
  Vec3 tick(const DeviceReading& reading) override;

  LiveStatus status() const noexcept { return status_.read(); }

 private:
  ForceGovernor governor_;
  ForceLaw law_;
  TickSink* sink_;
  double period_;
  std::int64_t steps_ = 0;
  Vec3 last_place_ = Vec3::Zero();
  StatusBoard status_;
};

// An active check: starts the device, watches and ends as run_live() does.
LiveEnd run_probe(HapticDevice& device, ProbeLoop& loop, const LiveWatch& watch);

}  // namespace toothprep
