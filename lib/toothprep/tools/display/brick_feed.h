// How changes of the cut leave the servo thread: copies of the bricks that changed, in a ring of
// fixed size with one writer and one reader, both wait-free.
//
//   grinding --marks--> ChangedBricks --tick(): a few copies--> ring --receive()--> reader's cut
//
// The reader never looks at the workpiece's cut, so nothing has to be consistent with it while it
// is written: it has a cut of its own, of which every sample is one that the session had. A tick
// copies no more than its share; the rest stays marked, in order, and goes in later ticks with the
// values that it has by then. So nothing is ever dropped, a brick that changes often costs one
// copy, and what is behind is bounded by the bricks of the tooth.
//
// After a cut of many bricks the reader may for some passes have some of them and not the others:
// it then shows a cut that is partly older, closed all the same.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <vector>

#include "toothprep/step/grinding/workpiece.h"
#include "toothprep/tools/display/display_stats.h"

namespace toothprep {

struct FeedOptions {
  // Bricks with values of their own (2 KB each) that one tick copies at most; of bricks that are
  // cut away as a whole, which have none, four times as many.
  int bricks_per_tick = 8;
  int ring_bricks = 1024;  // 2 MB; what a tick finds no room for stays marked
};

class BrickFeed {
 public:
  using Clock = std::chrono::steady_clock;
  struct Change {
    std::uint32_t brick = 0;
    bool uniform = false;  // all values are values[0]
    Clock::time_point changed;
    std::array<float, kBrickVoxels> values{};
  };

  // Forgets what was marked until now: the reader starts from a copy of the cut made at the same
  // time. Keeps a reference to the workpiece. Throws Error unless both options are positive.
  BrickFeed(Workpiece& workpiece, const FeedOptions& options);

  // The servo thread, once after each step. Allocates, locks and waits for nothing.
  void tick() noexcept;

  // The same without a limit but the ring's, for when the servo has stopped; false if bricks are
  // left.
  bool hand_over_all() noexcept;

  // The reader: calls use(change) for each brick that was in the ring when it was called; their
  // number.
  template <class Use>
  std::size_t receive(const Use& use) {
    const std::uint64_t end = written_.load(std::memory_order_acquire);
    const std::uint64_t begin = read_.load(std::memory_order_relaxed);
    for (std::uint64_t n = begin; n != end; ++n) {
      use(ring_[n % ring_.size()]);
      read_.store(n + 1, std::memory_order_release);
    }
    return end - begin;
  }

  // From any thread.
  FeedCounts counts() const noexcept;

 private:
  void hand_over(int bricks) noexcept;

  Workpiece& workpiece_;
  const FeedOptions options_;
  std::vector<Change> ring_;
  alignas(64) std::atomic<std::uint64_t> written_ = 0;
  alignas(64) std::atomic<std::uint64_t> read_ = 0;

  // The servo thread's own.
  std::vector<Clock::time_point> marked_at_;  // by number of the entry in ChangedBricks, a ring
  std::uint64_t known_;                       // entries that have their time

  alignas(64) std::atomic<std::uint64_t> ticks_ = 0, largest_backlog_ = 0, ring_full_ = 0;
};

}  // namespace toothprep
