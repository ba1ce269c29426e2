// A queue between one thread that puts and one that takes, without locks: the servo's thread puts a
// tick and never waits. All room is allocated, and touched, at the start.
//
// The indices count up for ever and are taken modulo the capacity, a power of two. Each side keeps
// a copy of the other's index and looks at the real one only when the copy says full (or empty), so
// that the cache line of one index rarely travels. An item is written before the index that shows
// it (release), and read after it (acquire).
#pragma once

#include <atomic>
#include <bit>
#include <cstddef>
#include <memory>
#include <type_traits>

namespace toothprep {

template <class T>
class SpscRing {  // see above
  static_assert(std::is_copy_assignable_v<T> && std::is_default_constructible_v<T>);

 public:
  // Room for `capacity` items, rounded up to a power of two.
  explicit SpscRing(std::size_t capacity)
      : mask_(std::bit_ceil(capacity < 2 ? std::size_t{2} : capacity) - 1),
        items_(std::make_unique<T[]>(mask_ + 1)) {}
  SpscRing(const SpscRing&) = delete;
  SpscRing& operator=(const SpscRing&) = delete;

  std::size_t capacity() const noexcept { return mask_ + 1; }  // items

  // The putting thread only. False if there is no room.
  bool push(const T& item) noexcept {
    const std::size_t at = put_.load(std::memory_order_relaxed);
    if (at - taken_seen_ > mask_) {
      taken_seen_ = taken_.load(std::memory_order_acquire);
      if (at - taken_seen_ > mask_) return false;
    }
    items_[at & mask_] = item;
    put_.store(at + 1, std::memory_order_release);
    return true;
  }

  // The taking thread only. Calls use(item) for what is there now, in order; returns how many. The
  // room of an item is free again when use() has returned.
  template <class Use>
  std::size_t consume(Use&& use) {
    const std::size_t first = taken_.load(std::memory_order_relaxed);
    const std::size_t end = put_.load(std::memory_order_acquire);
    for (std::size_t at = first; at != end; ++at) {
      use(static_cast<const T&>(items_[at & mask_]));
      taken_.store(at + 1, std::memory_order_release);
    }
    return end - first;
  }

  // The taking thread only: the one that waits longest. False if there is none.
  bool pop(T& item) {
    const std::size_t first = taken_.load(std::memory_order_relaxed);
    if (first == put_.load(std::memory_order_acquire)) return false;
    item = items_[first & mask_];
    taken_.store(first + 1, std::memory_order_release);
    return true;
  }

 private:
  static constexpr std::size_t kCacheLine = 64;

  const std::size_t mask_;
  const std::unique_ptr<T[]> items_;
  alignas(kCacheLine) std::atomic<std::size_t> put_{0};
  std::size_t taken_seen_ = 0;  // the putting thread's copy
  alignas(kCacheLine) std::atomic<std::size_t> taken_{0};
};

}  // namespace toothprep
