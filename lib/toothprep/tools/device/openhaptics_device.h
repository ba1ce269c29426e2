// Phantom devices (Desktop, Omni, Touch, Premium) through the vendor's OpenHaptics library, which
// is opened at run time (libhd.h). Position and force are its own: mm and N in frame D.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "toothprep/tools/device/haptic_device.h"

namespace toothprep {

struct OpenHapticsSettings {               // which device, and how it is run
  std::string name;                        // as configured in the driver; empty: its default device
  std::optional<std::string> mirror_name;  // a second device: read only, no force
  std::string library;                     // empty: as load_libhd() finds it
  // Hz; empty: the driver's. Devices know 500, 1000, and 2000 (EPP, PCI) or 1600 (FireWire).
  std::optional<long> rate;
  double ramp = 0.25;            // s, of the force after a start or a fault; 0: none
  double zero_force_wait = 0.2;  // s, the longest that stop() waits for a tick of zero force
  // s; a driver that doesn't come back from opening, from starting its servo, or from stopping and
  // closing is given up.
  double open_wait = 15, start_wait = 5, stop_wait = 2;
  std::function<bool()> stop_asked;  // looked at while it opens and starts; may be empty
};

// Opens the device (or both), reads its limits, and leaves the force off. One at a time per
// process, since the driver has one servo loop. Throws Error for a library that can't be opened,
// for a device that the driver doesn't open, with the driver's reason, and for a driver that hangs.
std::unique_ptr<HapticDevice> open_openhaptics(const OpenHapticsSettings& settings = {});

// Whether a driver that didn't come back from a call was left alone. The program should end without
// calling what libraries do at exit (std::_Exit): that may hang as well.
bool driver_was_given_up() noexcept;

}  // namespace toothprep
