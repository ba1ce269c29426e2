#include "toothprep/tools/live/probe_loop.h"

#include <utility>

#include "toothprep/tools/live/tick_cost.h"

namespace toothprep {

ProbeLoop::ProbeLoop(const ForceLimits& limits, ForceLaw law, TickSink* sink)
    : governor_(limits), law_(std::move(law)), sink_(sink), period_(limits.period) {}

Vec3 ProbeLoop::tick(const DeviceReading& reading) {
  const double from = thread_seconds();
  LiveTick out;
  note_reading(reading, out);
  const Vec3& place = reading.hand.position;
  if (steps_ == 0) last_place_ = place;
  const double time = static_cast<double>(steps_++) * period_;
  out.row.handle.time = time;
  out.row.handle.pose = {place, reading.hand.orientation};
  out.row.handle.buttons = 0;  // no bur runs
  out.row.bur = out.row.handle.pose;
  out.row.bur_velocity = (place - last_place_) / period_;
  Vec3 force = law_(time, place, place - last_place_);
  last_place_ = place;
  out.row.device_force = force.allFinite() ? force : Vec3(Vec3::Zero());
  if (reading.fault != DeviceFault::kNone) {
    governor_.restart();
    force.setZero();
    out.flags |= kForceWithheld;
  }
  out.commanded_force = governor_.limit(force, out.flags);
  out.step_seconds = thread_seconds() - from;
  if (sink_) sink_->take(out);
  status_.write(out, steps_, governor_);
  return out.commanded_force;
}

}  // namespace toothprep
