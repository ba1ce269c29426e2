#include "toothprep/tools/display/brick_feed.h"

#include <algorithm>
#include <limits>
#include <string>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

constexpr int kCostOfCopy = 4, kCostOfUniform = 1;

}  // namespace

BrickFeed::BrickFeed(Workpiece& workpiece, const FeedOptions& options)
    : workpiece_(workpiece), options_(options) {
  if (options.bricks_per_tick < 1 || options.ring_bricks < 1)
    throw Error("display: bricks per tick and in the ring must be positive, got " +
                std::to_string(options.bricks_per_tick) + " and " +
                std::to_string(options.ring_bricks));
  ring_.resize(static_cast<std::size_t>(options.ring_bricks));
  marked_at_.resize(workpiece.cut().table_size());
  ChangedBricks& changed = workpiece.changed();
  while (!changed.empty()) changed.take();
  known_ = changed.marked();
}

void BrickFeed::tick() noexcept {
  ticks_.store(ticks_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  hand_over(options_.bricks_per_tick);
}

void BrickFeed::hand_over(int bricks) noexcept {
  ChangedBricks& changed = workpiece_.changed();
  if (changed.empty()) return;
  if (known_ != changed.marked()) {
    const Clock::time_point now = Clock::now();
    for (; known_ != changed.marked(); ++known_) marked_at_[known_ % marked_at_.size()] = now;
  }

  const LevelSet& cut = workpiece_.cut();
  const std::uint64_t read = read_.load(std::memory_order_acquire);
  std::uint64_t written = written_.load(std::memory_order_relaxed);
  for (std::int64_t budget = std::int64_t{kCostOfCopy} * bricks; budget > 0 && !changed.empty();) {
    if (written - read == ring_.size()) {
      ring_full_.store(ring_full_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
      break;
    }
    Change& change = ring_[written % ring_.size()];
    change.changed = marked_at_[changed.taken() % marked_at_.size()];
    const std::size_t brick = changed.take();
    change.brick = static_cast<std::uint32_t>(brick);
    change.uniform = cut.is_uniform(brick);
    const float* values = cut.brick(brick);
    if (change.uniform) {
      change.values[0] = values[0];
      budget -= kCostOfUniform;
    } else {
      std::copy(values, values + kBrickVoxels, change.values.begin());
      budget -= kCostOfCopy;
    }
    written_.store(++written, std::memory_order_release);
  }
  const std::uint64_t backlog = changed.marked() - changed.taken();
  if (backlog > largest_backlog_.load(std::memory_order_relaxed))
    largest_backlog_.store(backlog, std::memory_order_relaxed);
}

bool BrickFeed::hand_over_all() noexcept {
  hand_over(std::numeric_limits<int>::max());
  return workpiece_.changed().empty();
}

FeedCounts BrickFeed::counts() const noexcept {
  return {ticks_.load(std::memory_order_relaxed), written_.load(std::memory_order_relaxed),
          largest_backlog_.load(std::memory_order_relaxed),
          ring_full_.load(std::memory_order_relaxed)};
}

}  // namespace toothprep
