// How changes of the cut reach the display's side.
#include <gtest/gtest.h>

#include <vector>

#include "slot.h"
#include "toothprep/tools/display/brick_feed.h"

namespace toothprep::testing {
namespace {

TEST(ChangedBricks, AreTakenInOrderAndOnceEach) {
  ChangedBricks changed(4);
  // Twice round the ring of four: 3, 1, then 0 while 1 waits, 3 again after it was taken.
  for (int round = 0; round < 2; ++round) {
    EXPECT_TRUE(changed.empty());
    for (std::size_t b : {3, 1, 3, 1}) changed.mark(b);
    EXPECT_EQ(changed.marked() - changed.taken(), 2u);
    EXPECT_EQ(changed.take(), 3u);
    for (std::size_t b : {0, 1, 3, 2}) changed.mark(b);
    for (std::size_t b : {1, 0, 3, 2}) EXPECT_EQ(changed.take(), b);
  }
  EXPECT_TRUE(changed.empty());
}

// A brick of the block that holds tissue, given a value.
void write(Workpiece& workpiece, std::size_t brick, float value) {
  workpiece.cut().writable_brick(brick)[5] = value;
  workpiece.changed().mark(brick);
}

TEST(BrickFeed, ATickHandsOverItsShareAndTheRestLaterWithItsNewestValues) {
  const LayeredTooth tooth = slot_block(0.2);
  Workpiece workpiece(tooth);
  write(workpiece, 1, 0.5f);  // before there was a feed
  BrickFeed feed(workpiece, {.bricks_per_tick = 2, .ring_bricks = 3});
  std::vector<std::pair<std::uint32_t, float>> got;
  const auto receive = [&] {
    got.clear();
    feed.receive([&](const BrickFeed::Change& c) { got.emplace_back(c.brick, c.values[5]); });
    return got;
  };
  using Got = std::vector<std::pair<std::uint32_t, float>>;
  feed.tick();
  EXPECT_EQ(receive(), Got{});

  for (std::size_t b : {10, 11, 12, 13}) write(workpiece, b, 0.1f);
  feed.tick();  // 10 and 11
  write(workpiece, 10, 0.2f);
  write(workpiece, 12, 0.3f);
  feed.tick();  // 12, and then the ring is full
  EXPECT_EQ(feed.counts().ring_full, 1u);
  EXPECT_EQ(receive(), (Got{{10, 0.1f}, {11, 0.1f}, {12, 0.3f}}));
  feed.tick();  // 13, and 10 once more
  EXPECT_EQ(receive(), (Got{{13, 0.1f}, {10, 0.2f}}));
  feed.tick();
  EXPECT_EQ(receive(), Got{});
  EXPECT_EQ(feed.counts().bricks, 5u);
  EXPECT_EQ(feed.counts().ticks, 5u);
  EXPECT_EQ(feed.counts().largest_backlog, 2u);
}

// A brick of which nothing is left has one value and costs a quarter of a share.
TEST(BrickFeed, ABrickCutAwayAsAWholeIsOneValue) {
  const LayeredTooth tooth = slot_block(0.2);
  Workpiece workpiece(tooth);
  BrickFeed feed(workpiece, {.bricks_per_tick = 1, .ring_bricks = 16});
  for (std::size_t b = 10; b < 16; ++b) {
    workpiece.cut().put_constant(b, Workpiece::kAllCut);
    workpiece.changed().mark(b);
  }
  feed.tick();
  int uniform = 0;
  const auto count = [&](const BrickFeed::Change& c) {
    uniform += c.uniform && c.values[0] == workpiece.band();
  };
  EXPECT_EQ(feed.receive(count), 4u);
  EXPECT_TRUE(feed.hand_over_all());
  EXPECT_EQ(feed.receive(count), 2u);
  EXPECT_EQ(uniform, 6);
}

}  // namespace
}  // namespace toothprep::testing
