// A packed level set is the function of the voxel that was stored, bit for bit, in less memory than
// a grid of bricks.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <random>

#include "toothprep/step/tooth/packed_level_set.h"

namespace toothprep {
namespace {

using Values = std::array<float, kBrickVoxels>;

constexpr float kBand = 3.0F;
const Index3 kFirst(-2, 0, 1), kCounts(4, 3, 2);  // voxels -16..15, 0..23, 8..23

PackedLevelSet small_set() { return PackedLevelSet(kFirst, kCounts, kBand); }
BrickGrid<float> unpacked_set() { return BrickGrid<float>(kFirst, kCounts, kBand, {-kBand}); }

// A brick of a level set: a plane that passes near its middle, within the band.
Values plane(std::mt19937& random) {
  const auto any = [&] { return static_cast<float>(random() % 2000) / 1000 - 1; };
  const float nx = any(), ny = any(), nz = any(), c = 3 * any();
  const float n = std::sqrt(nx * nx + ny * ny + nz * nz) + 1e-3F;
  Values values;
  for (int v = 0; v < kBrickVoxels; ++v) {
    const auto at = [](int i) { return static_cast<float>(i & 7) - 3.5F; };
    const float d = (nx * at(v >> 6) + ny * at(v >> 3) + nz * at(v)) / n + c;
    values[v] = std::min(std::max(d, -kBand), kBand);
  }
  return values;
}

void expect_same(const PackedLevelSet& set, const BrickGrid<float>& grid) {
  const auto bits = [](float x) { return std::bit_cast<std::uint32_t>(x); };
  for (int i = -20; i < 20; ++i)
    for (int j = -3; j < 27; ++j)
      for (int k = 5; k < 27; ++k)
        ASSERT_EQ(bits(set.value(i, j, k)), bits(grid.value(i, j, k))) << i << ' ' << j << ' ' << k;
  Values values;
  for (std::size_t b = 0; b < set.table_size(); ++b) {
    EXPECT_EQ(set.brick_origin(b), grid.brick_origin(b));
    EXPECT_EQ(set.is_uniform(b), grid.is_uniform(b));
    set.brick(b).unpack(values.data());
    for (int v = 0; v < kBrickVoxels; ++v) {
      ASSERT_EQ(bits(values[v]), bits(grid.brick(b)[v]));
      ASSERT_EQ(bits(set.brick(b)[v]), bits(grid.brick(b)[v]));
    }
  }
}

TEST(PackedLevelSet, IsTheBandInsideAndOutsideItsBox) {
  const PackedLevelSet set = small_set();
  EXPECT_EQ(set.background(), kBand);
  EXPECT_EQ(set.table_size(), 24u);
  EXPECT_EQ(set.value(0, 0, 8), kBand);
  EXPECT_EQ(set.value(1000000, -1000000, 3), kBand);
  expect_same(set, unpacked_set());
}

TEST(PackedLevelSet, ReadsBackBitForBitWhateverWasStored) {
  PackedLevelSet set = small_set();
  BrickGrid<float> grid = unpacked_set();
  std::mt19937 random(3);
  for (int n = 0; n < 200; ++n) {
    const std::size_t b = random() % set.table_size();
    Values values = plane(random);
    if (n % 4 == 1) values.fill(n % 8 == 1 ? kBand : -kBand);
    if (n % 4 == 2)
      for (float& v : values) v = static_cast<float>(random() % 7) - 3;  // every row differs
    if (n % 4 == 3) values[random() % kBrickVoxels] = n % 8 == 3 ? -0.0F : 0.0F;
    set.set_brick(b, values.data());
    grid.set_brick(b, values.data());
  }
  expect_same(set, grid);
  expect_same(set, set.unpacked());
  set.set_uniform(3, 0.5F);
  grid.set_uniform(3, 0.5F);
  set.set_uniform(4, -kBand);
  grid.set_uniform(4, -kBand);
  expect_same(set, grid);
}

TEST(PackedLevelSet, TakesTheRowsWithinTheBandAndNothingForUniformBricks) {
  PackedLevelSet set = small_set();
  const std::size_t table = 24 * sizeof(std::uint32_t);
  EXPECT_EQ(set.memory_bytes(), table);
  set.set_uniform(5, -kBand);
  set.set_uniform(6, kBand);
  EXPECT_EQ(set.memory_bytes(), table);
  // A face across x: of eight layers the five within the band, 16 rows of 16 bytes each.
  Values values;
  for (int v = 0; v < kBrickVoxels; ++v)
    values[v] = std::min(std::max(static_cast<float>(v >> 6) - 4, -kBand), kBand);
  set.set_brick(7, values.data());
  EXPECT_EQ(set.memory_bytes(), table + 128 + (2 + 5 * 16) * 16);
}

TEST(PackedLevelSet, CopiesShareWhatIsStoredAndChangeApart) {
  std::mt19937 random(5);
  PackedLevelSet set = small_set();
  BrickGrid<float> grid = unpacked_set();
  const Values first = plane(random), second = plane(random), third = plane(random);
  set.set_brick(2, first.data());
  grid.set_brick(2, first.data());
  PackedLevelSet copy = set;
  BrickGrid<float> grid_copy = grid;
  set.set_brick(8, second.data());
  grid.set_brick(8, second.data());
  copy.set_brick(8, third.data());
  grid_copy.set_brick(8, third.data());
  expect_same(set, grid);
  expect_same(copy, grid_copy);
  set = PackedLevelSet();  // the storage stays as long as somebody refers to it
  expect_same(copy, grid_copy);
}

TEST(PackedLevelSet, SharesBricksOfAFrozenGridThatAreTheSame) {
  std::mt19937 random(7);
  BrickGrid<float> solid = unpacked_set();
  const Values values = plane(random), others = plane(random);
  solid.set_brick(2, values.data());
  solid.set_brick(9, others.data());
  PackedLevelSet set = small_set();
  const std::size_t empty = set.memory_bytes();
  EXPECT_FALSE(set.share_brick(2, values.data(), solid));  // not frozen
  solid.freeze();
  EXPECT_FALSE(set.share_brick(9, values.data(), solid));  // not the same
  EXPECT_FALSE(set.share_brick(3, values.data(), solid));  // uniform
  EXPECT_TRUE(set.share_brick(2, values.data(), solid));
  EXPECT_EQ(set.memory_bytes(), empty);
  EXPECT_EQ(set.shared().bricks, solid.shared().bricks);
  BrickGrid<float> grid = unpacked_set();
  grid.set_brick(2, values.data());
  expect_same(set, grid);

  BrickGrid<float> another = unpacked_set();
  another.set_brick(9, others.data());
  another.freeze();
  EXPECT_FALSE(set.share_brick(9, others.data(), another));  // another's storage
  solid.writable_brick(2)[0] = 1;
  another = solid = BrickGrid<float>();
  expect_same(set, grid);
}

TEST(PackedLevelSet, SharesBricksThatAreTheNegativeOfAnothers) {
  std::mt19937 random(11);
  PackedLevelSet dentin = small_set(), enamel = small_set();
  BrickGrid<float> grid = unpacked_set();
  Values its = plane(random), values;
  const auto negate = [&] {
    for (int v = 0; v < kBrickVoxels; ++v) values[v] = -its[v];
  };
  its[17] = 0.0F;
  negate();
  dentin.set_brick(2, its.data());
  grid.set_brick(2, values.data());
  const std::size_t empty = enamel.memory_bytes();
  EXPECT_TRUE(enamel.share_negative(2, values.data(), dentin));
  EXPECT_EQ(enamel.memory_bytes(), empty);
  expect_same(enamel, grid);
  values[17] = 0.0F;  // which is not minus zero
  EXPECT_FALSE(enamel.share_negative(2, values.data(), dentin));
  EXPECT_FALSE(enamel.share_negative(3, values.data(), dentin));  // uniform there

  // What each stores afterwards is its own.
  const Values later = plane(random);
  dentin.set_brick(2, later.data());
  dentin.set_brick(4, later.data());
  its = later;
  negate();
  enamel.set_brick(5, later.data());
  grid.set_brick(5, later.data());
  expect_same(enamel, grid);

  PackedLevelSet late = small_set();
  late.set_brick(1, later.data());
  EXPECT_FALSE(late.share_negative(4, values.data(), dentin));  // its storage isn't known there
}

}  // namespace
}  // namespace toothprep
