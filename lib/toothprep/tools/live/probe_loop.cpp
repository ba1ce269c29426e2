#include "toothprep/tools/live/probe_loop.h"

#include <utility>

#include "toothprep/tools/live/tick_cost.h"

namespace toothprep {

ProbeLoop::ProbeLoop(const ForceLimits& limits, ForceLaw law, TickSink* sink,
                     const ReadingLimits& readings, bool safety_switch)
    : governor_(limits),
      check_(readings),
      law_(std::move(law)),
      sink_(sink),
      period_(limits.period),
      safety_switch_(safety_switch) {}

Vec3 ProbeLoop::tick(const DeviceReading& reading) {
  const double from = thread_seconds();
  LiveTick out;
  note_reading(reading, out);
  const Vec3& place = reading.hand.position;
  const ReadingFault fault = check_.judge(reading);
  const bool rejected = fault != ReadingFault::kNone;
  const bool free = safety_switch_ && !reading.hand.safety_switch.value_or(true);
  if (steps_ == 0) last_place_ = place;
  const double time = static_cast<double>(steps_++) * period_;
  out.row.handle.time = time;
  out.row.handle.pose = {place, reading.hand.orientation};
  out.row.handle.buttons = 0;  // no bur runs
  out.row.handle.rejected = rejected;
  out.row.bur = out.row.handle.pose;
  Vec3 force = Vec3::Zero();
  if (!rejected) {
    out.row.bur_velocity = (place - last_place_) / period_;
    force = law_(time, place, place - last_place_);
    last_place_ = place;
  }
  out.row.device_force = force.allFinite() ? force : Vec3(Vec3::Zero());
  if (rejected) out.flags |= kReadingRejected;
  if (rejected || check_.resumed()) governor_.restart();
  const bool withheld = rejected || free || reading.fault != DeviceFault::kNone;
  governor_.fade_out(fade_wanted_.load(std::memory_order_relaxed));
  out.commanded_force =
      withheld ? governor_.withhold(out.flags) : governor_.limit(force, out.flags);
  out.step_seconds = thread_seconds() - from;
  if (sink_) sink_->take(out);
  status_.write(out, steps_, governor_);
  status_.write(fault, check_.lost(), free);
  return out.commanded_force;
}

}  // namespace toothprep
