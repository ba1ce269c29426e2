// Labels carried into the air are those of the nearest labelled neighbour, voxel by voxel.
#include <gtest/gtest.h>

#include <cstdint>
#include <random>

#include "toothprep/step/tooth/extended_labels.h"

namespace toothprep {
namespace {

constexpr int kVoxels = 16;    // each way
constexpr float kReach = 0.5;  // of values in [0, 1)

template <class Grid, class Value>
void fill(Grid& grid, const Value& value) {
  for (int i = 0; i < kVoxels; ++i)
    for (int j = 0; j < kVoxels; ++j)
      for (int k = 0; k < kVoxels; ++k)
        grid.writable_brick(static_cast<std::size_t>(
            grid.brick_index(i, j, k)))[brick_offset(i & 7, j & 7, k & 7)] = value(i, j, k);
}

// What the header says, for one layer and one voxel.
std::uint8_t expected(const LabelGrid& labels, const LevelSet& solid, int i, int j, int k) {
  const std::uint8_t own = labels.value(i, j, k);
  if (own != 0 || solid.value(i, j, k) > kReach) return own;
  for (int apart = 1; apart <= 3; ++apart)  // axes: face, edge, corner
    for (int x = -1; x <= 1; ++x)
      for (int y = -1; y <= 1; ++y)
        for (int z = -1; z <= 1; ++z) {
          const std::uint8_t label = labels.value(i + x, j + y, k + z);
          if (x * x + y * y + z * z == apart && label != 0) return label;
        }
  return 0;
}

TEST(ExtendedLabels, TakeTheNearestNeighboursLayerByLayer) {
  std::mt19937 random(5);  // its sequence is fixed by the standard
  // Few labels in the air, and few voxels of air among labels.
  for (const unsigned labelled : {2U, 10U, 50U, 95U}) {
    LabelGrid labels(Index3::Zero(), Index3::Constant(2), std::uint8_t{0});
    LevelSet solid(Index3::Zero(), Index3::Constant(2), 1.0F);
    fill(labels, [&](int, int, int) {
      return static_cast<std::uint8_t>(random() % 100 < labelled ? 1 + random() % 4 : 0);
    });
    fill(solid, [&](int, int, int) { return static_cast<float>(random() % 1000) / 1000; });
    LabelGrid layer = labels;
    for (const int layers : {1, 2}) {
      LabelGrid next = layer;
      fill(next, [&](int i, int j, int k) { return expected(layer, solid, i, j, k); });
      layer = next;
      const LabelGrid extended = extended_labels(labels, solid, kReach, layers);
      int wrong = 0;
      for (int v = 0; v < kVoxels * kVoxels * kVoxels; ++v) {
        const int i = v / (kVoxels * kVoxels), j = v / kVoxels % kVoxels, k = v % kVoxels;
        wrong += extended.value(i, j, k) != layer.value(i, j, k);
      }
      EXPECT_EQ(wrong, 0) << labelled << " % labelled, " << layers << " layers";
    }
  }
}

}  // namespace
}  // namespace toothprep
