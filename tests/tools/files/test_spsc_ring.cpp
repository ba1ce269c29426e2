#include <gtest/gtest.h>

#include <array>
#include <thread>

#include "toothprep/step/core/spsc_ring.h"

namespace toothprep {
namespace {

TEST(SpscRing, TheCapacityIsRoundedUpToAPowerOfTwo) {
  EXPECT_EQ(SpscRing<int>(1).capacity(), 2u);
  EXPECT_EQ(SpscRing<int>(8).capacity(), 8u);
  EXPECT_EQ(SpscRing<int>(8000).capacity(), 8192u);
}

TEST(SpscRing, GivesBackInOrderAndRefusesWhenFull) {
  SpscRing<int> ring(4);
  std::vector<int> taken;
  const auto take = [&] { return ring.consume([&](int v) { taken.push_back(v); }); };
  for (int i = 0; i < 4; ++i) EXPECT_TRUE(ring.push(i));
  EXPECT_FALSE(ring.push(4));
  EXPECT_EQ(take(), 4u);
  EXPECT_EQ(take(), 0u);
  for (int i = 5; i < 8; ++i) EXPECT_TRUE(ring.push(i));  // over the end of the memory
  EXPECT_EQ(take(), 3u);
  EXPECT_EQ(taken, (std::vector{0, 1, 2, 3, 5, 6, 7}));
}

// A million items of several words through a ring of 256: none lost, none twice, none torn.
TEST(SpscRing, TwoThreadsSeeEveryItemOnceAndWhole) {
  using Item = std::array<std::uint64_t, 9>;
  constexpr std::uint64_t kItems = 1'000'000;
  SpscRing<Item> ring(256);
  std::thread putting([&] {
    Item item{};
    for (std::uint64_t i = 0; i < kItems; ++i) {
      item.fill(i * 0x9e3779b97f4a7c15u);
      while (!ring.push(item)) std::this_thread::yield();
    }
  });
  std::uint64_t next = 0, wrong = 0;
  while (next < kItems) {
    const std::size_t n = ring.consume([&](const Item& item) {
      for (const std::uint64_t v : item) wrong += v != next * 0x9e3779b97f4a7c15u;
      ++next;
    });
    if (n == 0) std::this_thread::yield();
  }
  putting.join();
  EXPECT_EQ(wrong, 0u);
  EXPECT_EQ(ring.consume([](const Item&) {}), 0u);
}

}  // namespace
}  // namespace toothprep
