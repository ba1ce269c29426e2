// What a recording says about the device that it was made with.
#pragma once

#include <string>

#include "toothprep/tools/device/haptic_device.h"
#include "toothprep/tools/files/session_file.h"
#include "toothprep/tools/live/live_watch.h"

namespace toothprep {

// Throws Error that tells what to do, unless the device is calibrated.
void check_calibration(HapticDevice& device);

// Fills the header's device_..., limits, workspace and host.
void describe_device(const HapticDevice& device, const ForceLimits& limits,
                     const ReadingLimits& readings, bool safety_switch, const LiveWatch& watch,
                     SessionHeader& header);

}  // namespace toothprep
