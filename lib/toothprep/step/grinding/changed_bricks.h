// Which bricks of the cut have changed: what a display needs to know.
//
// A queue of brick indices in the order of their first change, each at most once, so that it never
// holds more than the grid has bricks: marking and taking allocate nothing and never fail, whether
// or not anybody takes. Both belong to the thread that grinds.
#pragma once

#include <cstdint>
#include <vector>

namespace toothprep {

class ChangedBricks {  // each at most once in the queue; for one thread
 public:
  ChangedBricks() = default;
  explicit ChangedBricks(std::size_t bricks) : waits_(bricks, 0), queue_(bricks) {}  // of a grid

  // The brick's values are about to change, or have just changed.
  void mark(std::size_t brick) noexcept {
    ++changes_;
    if (waits_[brick]) return;
    waits_[brick] = 1;
    queue_[back_] = static_cast<std::uint32_t>(brick);
    if (++back_ == queue_.size()) back_ = 0;
    ++marked_;
  }

  // Calls of mark() so far: the cut is as it was while this is.
  std::uint64_t changes() const noexcept { return changes_; }

  // Entries so far, and of these those taken: entry number n is the (n - taken())th that waits.
  std::uint64_t marked() const noexcept { return marked_; }
  std::uint64_t taken() const noexcept { return taken_; }
  bool empty() const noexcept { return marked_ == taken_; }

  // The brick that waits longest; not when empty. A brick that changes again after it was taken
  // queues again.
  std::size_t take() noexcept {
    const std::uint32_t brick = queue_[front_];
    if (++front_ == queue_.size()) front_ = 0;
    waits_[brick] = 0;
    ++taken_;
    return brick;
  }

 private:
  std::vector<std::uint8_t> waits_;   // per brick: is it in the queue?
  std::vector<std::uint32_t> queue_;  // a ring
  std::size_t front_ = 0, back_ = 0;
  std::uint64_t marked_ = 0, taken_ = 0, changes_ = 0;
};

}  // namespace toothprep
