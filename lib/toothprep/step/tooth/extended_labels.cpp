#include "toothprep/step/tooth/extended_labels.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

namespace toothprep {
namespace {

constexpr int kEdge = kBrickEdge + 2;  // of a brick with a voxel all round

// Voxel (x, y, z) of a brick with a voxel all round, each -1..8.
constexpr int at(int x, int y, int z) { return ((x + 1) * kEdge + y + 1) * kEdge + z + 1; }

using Around = std::array<std::uint8_t, kEdge * kEdge * kEdge>;

// The labels of a brick and of the voxels beside it.
void look_around(const LabelGrid& labels, std::size_t brick, Around& around) {
  std::array<std::uint8_t, kBrickVoxels> outside;
  outside.fill(labels.background());
  const Index3 first = labels.brick_origin(brick);
  for (int x = -1; x <= kBrickEdge; ++x)
    for (int y = -1; y <= kBrickEdge; ++y) {
      const auto row = [&](int z) {
        const std::int64_t b = labels.brick_index(first.x() + x, first.y() + y, first.z() + z);
        return (b < 0 ? outside.data() : labels.brick(static_cast<std::size_t>(b))) +
               brick_offset(x & 7, y & 7, 0);
      };
      around[at(x, y, -1)] = row(-1)[kBrickEdge - 1];
      std::copy_n(row(0), kBrickEdge, &around[at(x, y, 0)]);
      around[at(x, y, kBrickEdge)] = row(kBrickEdge)[0];
    }
}

// Of each voxel of the brick whether it or one of the 26 beside it has a label.
void mark_near(const Around& around, std::array<std::uint8_t, kBrickVoxels>& near) {
  Around row{}, plane{};
  for (int x = -1; x <= kBrickEdge; ++x)
    for (int y = -1; y <= kBrickEdge; ++y)
      for (int z = 0; z < kBrickEdge; ++z)
        row[at(x, y, z)] = around[at(x, y, z - 1)] | around[at(x, y, z)] | around[at(x, y, z + 1)];
  for (int x = -1; x <= kBrickEdge; ++x)
    for (int y = 0; y < kBrickEdge; ++y)
      for (int z = 0; z < kBrickEdge; ++z)
        plane[at(x, y, z)] = row[at(x, y - 1, z)] | row[at(x, y, z)] | row[at(x, y + 1, z)];
  for (int x = 0; x < kBrickEdge; ++x)
    for (int y = 0; y < kBrickEdge; ++y)
      for (int z = 0; z < kBrickEdge; ++z)
        near[brick_offset(x, y, z)] =
            plane[at(x - 1, y, z)] | plane[at(x, y, z)] | plane[at(x + 1, y, z)];
}

// Offsets to the 26 voxels beside one, the nearest first.
std::vector<int> offsets_beside() {
  std::vector<Index3> n;
  for (int x = -1; x <= 1; ++x)
    for (int y = -1; y <= 1; ++y)
      for (int z = -1; z <= 1; ++z)
        if (x || y || z) n.emplace_back(x, y, z);
  std::stable_sort(n.begin(), n.end(), [](const Index3& a, const Index3& b) {
    return a.squaredNorm() < b.squaredNorm();
  });
  std::vector<int> offsets;
  for (const Index3& i : n) offsets.push_back(at(i.x(), i.y(), i.z()) - at(0, 0, 0));
  return offsets;
}

LabelGrid with_another_layer(const LabelGrid& labels, const LevelSet& solid, float reach) {
  static const std::vector<int> beside = offsets_beside();
  LabelGrid extended = labels;
  Around around;
  std::array<std::uint8_t, kBrickVoxels> near;
  for (std::size_t b = 0; b < labels.table_size(); ++b) {
    if (solid.is_uniform(b)) continue;  // no surface within the band
    if (labels.is_uniform(b) && labels.uniform_value(b) != 0) continue;
    const std::uint8_t* here = labels.brick(b);
    const float* phi = solid.brick(b);
    look_around(labels, b, around);
    mark_near(around, near);
    std::uint8_t* target = nullptr;
    for (int v = 0; v < kBrickVoxels; ++v) {
      if (here[v] != 0 || near[v] == 0 || phi[v] > reach) continue;
      const int middle = at(v >> 6, (v >> 3) & 7, v & 7);
      const auto nearest = std::find_if(beside.begin(), beside.end(), [&](int offset) {
        return around[static_cast<std::size_t>(middle + offset)] != 0;
      });
      if (!target) target = extended.writable_brick(b);
      target[v] = around[static_cast<std::size_t>(middle + *nearest)];
    }
  }
  return extended;
}

}  // namespace

LabelGrid extended_labels(const LabelGrid& labels, const LevelSet& solid, float reach, int layers) {
  LabelGrid extended = labels;
  for (int layer = 0; layer < layers; ++layer)
    extended = with_another_layer(extended, solid, reach);
  return extended;
}

}  // namespace toothprep
