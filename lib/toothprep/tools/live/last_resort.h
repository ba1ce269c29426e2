// Zero force before a signal ends the program: SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT (and with it
// std::terminate).
//
// The handler asks the device for zero force and waits kLastTick for the servo's next tick to send
// it; then the signal does what it does by default. Nothing can be sent if the servo's own thread
// is the one that failed, and SIGKILL can't be caught: then the driver's and the device's own
// watchdogs remain.
#pragma once

#include <signal.h>

#include <array>

#include "toothprep/tools/device/haptic_device.h"

namespace toothprep {

constexpr double kLastTick = 0.02;  // s

// While it lives, for one device.
class LastResort {
 public:
  explicit LastResort(HapticDevice& device) noexcept;
  ~LastResort();
  LastResort(const LastResort&) = delete;
  LastResort& operator=(const LastResort&) = delete;

 private:
  static constexpr std::array<int, 5> kSignals = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
  std::array<struct sigaction, kSignals.size()> before_;
};

}  // namespace toothprep
