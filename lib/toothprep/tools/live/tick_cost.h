// What every servo tick of ours notes.
#pragma once

#include <time.h>

#include "toothprep/step/core/live_tick.h"
#include "toothprep/tools/device/haptic_device.h"

namespace toothprep {

// CPU time of this thread, s: what a tick costs, however long it had to wait for the processor.
inline double thread_seconds() noexcept {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

// The device's side of a tick.
inline void note_reading(const DeviceReading& reading, LiveTick& out) noexcept {
  out.tick = reading.tick;
  out.servo_time = reading.time;
  out.missed = reading.missed;
  out.device_position = reading.hand.position;
  out.device_orientation = reading.hand.orientation;
  out.device_buttons = reading.hand.buttons;
  if (const auto& held = reading.hand.safety_switch) out.flags |= *held ? kSwitchHeld : kSwitchOpen;
  if (reading.mirror) {
    out.has_mirror = true;
    out.mirror_position = reading.mirror->position;
    out.mirror_orientation = reading.mirror->orientation;
    out.mirror_buttons = reading.mirror->buttons;
  }
  out.sent_force = reading.previous_force;
  out.force_scale = reading.force_scale;
  out.fault = static_cast<std::uint32_t>(reading.fault);
}

}  // namespace toothprep
