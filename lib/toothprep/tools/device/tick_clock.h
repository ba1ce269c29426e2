// The monotonic clock of servo loops, s. Sleeping is to absolute deadlines, so that lateness of one
// tick doesn't shift the next.
#pragma once

#include <time.h>

#include <cerrno>
#include <cmath>

namespace toothprep {

inline double monotonic_time() noexcept {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

inline void sleep_until(double deadline) noexcept {
  const double whole = std::floor(deadline);
  timespec at{};
  at.tv_sec = static_cast<time_t>(whole);
  at.tv_nsec = static_cast<long>((deadline - whole) * 1e9);
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr) == EINTR) {
  }
}

}  // namespace toothprep
