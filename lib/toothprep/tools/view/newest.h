// The newest of values that one thread writes and another reads: neither waits for the other.
#pragma once

#include <array>
#include <atomic>

namespace toothprep {

// Three places: one being written, one being read, and the newest whole one between them. A copy of a
// T must not allocate.
template <class T>
class Newest {
 public:
  // The writer's thread. What nobody has read is gone.
  void write(const T& value) noexcept {
    places_[written_] = value;
    written_ = between_.exchange(written_ | kFresh, std::memory_order_acq_rel) & kPlace;
  }

  // The reader's thread; false if nothing was written since.
  bool read(T& value) noexcept {
    if (!(between_.load(std::memory_order_relaxed) & kFresh)) return false;
    read_ = between_.exchange(read_, std::memory_order_acq_rel) & kPlace;
    value = places_[read_];
    return true;
  }

 private:
  static constexpr unsigned kPlace = 3, kFresh = 4;
  std::array<T, 3> places_{};
  unsigned written_ = 0, read_ = 1;
  std::atomic<unsigned> between_ = 2;
};

}  // namespace toothprep
