#include "toothprep/tools/live/last_resort.h"

#include <time.h>

#include <atomic>

namespace toothprep {
namespace {

std::atomic<HapticDevice*> last_device = nullptr;

void on_signal(int signal) {
  if (HapticDevice* const device = last_device.exchange(nullptr)) {
    device->zero_force_soon();
    timespec left{0, static_cast<long>(1e9 * kLastTick)};
    while (nanosleep(&left, &left) != 0) {
    }
  }
  raise(signal);  // SA_RESETHAND: by default now
}

}  // namespace

LastResort::LastResort(HapticDevice& device) noexcept {
  last_device = &device;
  struct sigaction action = {};
  action.sa_handler = on_signal;
  action.sa_flags = static_cast<int>(SA_RESETHAND | SA_NODEFER);
  for (std::size_t i = 0; i < kSignals.size(); ++i) sigaction(kSignals[i], &action, &before_[i]);
}

LastResort::~LastResort() {
  for (std::size_t i = 0; i < kSignals.size(); ++i) sigaction(kSignals[i], &before_[i], nullptr);
  last_device = nullptr;
}

}  // namespace toothprep
