// The brick grid behaves as a plain function of the voxel, however its bricks are stored, and takes
// no memory in the step once it is reserved.
#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <map>
#include <random>
#include <utility>

#include "toothprep/step/tooth/brick_grid.h"

namespace toothprep {
namespace {

using Grid = BrickGrid<float>;

Grid small_grid() { return Grid(Index3(-2, 0, 1), Index3(4, 3, 2), 0.5F, {-0.5F, 7.0F}); }

void write(Grid& grid, int i, int j, int k, float value) {
  float* brick = grid.writable_brick(static_cast<std::size_t>(grid.brick_index(i, j, k)));
  brick[brick_offset(i & 7, j & 7, k & 7)] = value;
}

TEST(BrickGrid, IsTheBackgroundInsideAndOutsideItsBox) {
  const Grid grid = small_grid();
  EXPECT_EQ(grid.value(0, 0, 8), 0.5F);
  EXPECT_EQ(grid.value(-16, 0, 8), 0.5F);
  EXPECT_EQ(grid.value(1000000, -1000000, 3), 0.5F);
  EXPECT_EQ(grid.bricks_stored(), 0u);
  EXPECT_EQ(grid.table_size(), 24u);
}

TEST(BrickGrid, BoxIsAlignedToBricksAlsoBelowZero) {
  const Grid grid = small_grid();  // voxels -16..15, 0..23, 8..23
  EXPECT_GE(grid.brick_index(-16, 0, 8), 0);
  EXPECT_GE(grid.brick_index(15, 23, 23), 0);
  EXPECT_EQ(grid.brick_index(-17, 0, 8), -1);
  EXPECT_EQ(grid.brick_index(16, 0, 8), -1);
  EXPECT_EQ(grid.brick_index(0, -1, 8), -1);
  EXPECT_EQ(grid.brick_index(0, 24, 8), -1);
  EXPECT_EQ(grid.brick_index(0, 0, 7), -1);
  EXPECT_EQ(grid.brick_index(0, 0, 24), -1);
}

TEST(BrickGrid, BrickOriginInvertsBrickIndex) {
  const Grid grid = small_grid();
  for (std::size_t b = 0; b < grid.table_size(); ++b) {
    const Index3 o = grid.brick_origin(b);
    for (const int d : {0, 7})
      EXPECT_EQ(grid.brick_index(o.x() + d, o.y() + d, o.z() + d), static_cast<std::int64_t>(b));
  }
}

TEST(BrickGrid, ReadsBackWhatRandomWritesLeft) {
  Grid grid = small_grid();
  std::map<std::array<int, 3>, float> truth;
  std::mt19937 random(3);  // its sequence is fixed by the standard
  for (int n = 0; n < 4000; ++n) {
    const int i = static_cast<int>(random() % 32) - 16, j = static_cast<int>(random() % 24),
              k = static_cast<int>(random() % 16) + 8;
    const auto value = static_cast<float>(random() % 1000);
    write(grid, i, j, k, value);
    truth[{i, j, k}] = value;
  }
  for (int i = -20; i < 20; ++i)
    for (int j = -4; j < 28; ++j)
      for (int k = 4; k < 28; ++k) {
        const auto found = truth.find({i, j, k});
        ASSERT_EQ(grid.value(i, j, k), found == truth.end() ? 0.5F : found->second);
      }
}

TEST(BrickGrid, WritingOneUniformBrickLeavesTheOthersAlone) {
  Grid grid = small_grid();
  const auto a = static_cast<std::size_t>(grid.brick_index(0, 0, 8));
  const auto b = static_cast<std::size_t>(grid.brick_index(0, 8, 8));
  grid.set_uniform(a, -0.5F);
  grid.set_uniform(b, -0.5F);
  EXPECT_EQ(grid.bricks_stored(), 0u);
  write(grid, 0, 0, 8, 3.0F);
  EXPECT_FALSE(grid.is_uniform(a));
  EXPECT_TRUE(grid.is_uniform(b));
  EXPECT_EQ(grid.value(0, 0, 8), 3.0F);
  EXPECT_EQ(grid.value(0, 0, 9), -0.5F) << "the rest of the brick keeps its value";
  EXPECT_EQ(grid.value(0, 8, 8), -0.5F) << "and so does its twin";
  EXPECT_EQ(grid.background(), 0.5F);
  EXPECT_EQ(grid.bricks_stored(), 1u);
}

TEST(BrickGrid, OnlyConstantsAreStoredAsUniformBricks) {
  Grid grid = small_grid();
  std::array<float, kBrickVoxels> values;
  values.fill(7.0F);
  grid.set_brick(0, values.data());
  EXPECT_TRUE(grid.is_uniform(0));
  EXPECT_EQ(grid.uniform_value(0), 7.0F);
  values.fill(6.0F);  // uniform, but not one of the constants
  grid.set_brick(1, values.data());
  EXPECT_FALSE(grid.is_uniform(1));
  grid.set_uniform(2, 6.0F);
  EXPECT_FALSE(grid.is_uniform(2));
  for (const int b : {1, 2})
    for (int v = 0; v < kBrickVoxels; ++v) ASSERT_EQ(grid.brick(b)[v], 6.0F);
  values[511] = 7.0F;  // differs in the last voxel only
  grid.set_brick(3, values.data());
  EXPECT_FALSE(grid.is_uniform(3));
  EXPECT_EQ(grid.brick(3)[511], 7.0F);
}

TEST(BrickGrid, ReservedBricksAreWrittenWithoutMovingTheOthers) {
  Grid grid = small_grid();
  grid.reserve(5);
  const std::size_t room = grid.bricks_free();
  ASSERT_GE(room, 5u);
  const float* first = grid.writable_brick(0, false);
  for (std::size_t b = 1; b < 5; ++b) ASSERT_NE(grid.writable_brick(b, false), nullptr);
  EXPECT_EQ(grid.brick(0), first) << "the pool was not reallocated";
  EXPECT_EQ(grid.bricks_free(), room - 5);
  EXPECT_EQ(grid.writable_brick(0, false), first) << "a stored brick needs no room";
}

TEST(BrickGrid, AnExhaustedPoolSaysSoInsteadOfAllocating) {
  Grid grid = small_grid();
  grid.reserve(2);
  std::size_t b = 0;
  while (grid.bricks_free() > 0) ASSERT_NE(grid.writable_brick(b++, false), nullptr);
  EXPECT_EQ(grid.writable_brick(b, false), nullptr);
  EXPECT_TRUE(grid.is_uniform(b)) << "the refused brick is as it was";
  EXPECT_NE(grid.writable_brick(b, true), nullptr);
}

TEST(BrickGrid, CopiesShareNothing) {
  Grid grid = small_grid();
  write(grid, 1, 2, 9, 4.0F);
  Grid copy = grid;
  write(copy, 1, 2, 9, 5.0F);
  write(copy, 8, 2, 9, 6.0F);
  EXPECT_EQ(grid.value(1, 2, 9), 4.0F);
  EXPECT_EQ(grid.value(8, 2, 9), 0.5F);
  EXPECT_EQ(copy.value(1, 2, 9), 5.0F);
  grid = copy;
  EXPECT_EQ(grid.value(8, 2, 9), 6.0F);
  const Grid moved = std::move(copy);
  EXPECT_EQ(moved.value(8, 2, 9), 6.0F);
}

TEST(BrickGrid, FrozenBricksAreSharedUntilOneWrites) {
  Grid grid = small_grid();
  write(grid, 1, 2, 9, 4.0F);
  write(grid, 8, 2, 9, 3.0F);
  const auto first = static_cast<std::size_t>(grid.brick_index(1, 2, 9)),
             second = static_cast<std::size_t>(grid.brick_index(8, 2, 9));
  const std::size_t bytes = grid.memory_bytes();
  grid.freeze();
  EXPECT_EQ(grid.bricks_stored(), 2u);
  EXPECT_LE(grid.memory_bytes() + grid.shared().memory_bytes(),
            bytes + 3 * kBrickVoxels * sizeof(float));

  Grid copy = grid, equal = small_grid(), other = small_grid();
  write(other, 1, 2, 9, 4.0F);
  EXPECT_EQ(copy.shared().bricks, grid.shared().bricks);
  EXPECT_FALSE(equal.share_brick(first, other));  // not frozen
  other.freeze();
  EXPECT_TRUE(equal.share_brick(first, grid));
  EXPECT_FALSE(equal.share_brick(first, other));  // another's storage
  EXPECT_FALSE(equal.share_brick(0, grid));       // uniform
  EXPECT_EQ(equal.bricks_stored(), 1u);
  EXPECT_EQ(equal.value(1, 2, 9), 4.0F);
  EXPECT_EQ(equal.brick(first), grid.brick(first));

  write(copy, 1, 2, 9, 5.0F);
  EXPECT_FALSE(copy.is_shared(first));
  EXPECT_FALSE(grid.share_brick(first, copy));  // has been written
  copy.set_uniform(second, 7.0F);
  EXPECT_EQ(copy.bricks_stored(), 1u);
  EXPECT_EQ(grid.value(1, 2, 9), 4.0F);
  EXPECT_EQ(grid.value(8, 2, 9), 3.0F);
  EXPECT_EQ(copy.value(1, 2, 9), 5.0F);
  EXPECT_EQ(copy.value(8, 2, 9), 7.0F);
  grid.put_constant(first, 0);
  EXPECT_EQ(equal.value(1, 2, 9), 4.0F);
  grid = Grid();  // the storage stays as long as somebody refers to it
  EXPECT_EQ(equal.value(1, 2, 9), 4.0F);
}

TEST(BrickGrid, MemoryGrowsByWholeBricks) {
  Grid grid = small_grid();
  const std::size_t before = grid.memory_bytes();
  write(grid, 0, 0, 8, 1.0F);
  write(grid, 1, 0, 8, 1.0F);
  EXPECT_EQ(grid.memory_bytes(), before + kBrickVoxels * sizeof(float));
}

}  // namespace
}  // namespace toothprep
