#include "toothprep/step/tooth/extended_labels.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
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
  std::array<const std::uint8_t*, 27> bricks;
  for (int n = 0; n < 27; ++n) {
    const Index3 from = first + kBrickEdge * Index3(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
    const std::int64_t b = labels.brick_index(from.x(), from.y(), from.z());
    bricks[static_cast<std::size_t>(n)] =
        b < 0 ? outside.data() : labels.brick(static_cast<std::size_t>(b));
  }
  for (int x = -1; x <= kBrickEdge; ++x)
    for (int y = -1; y <= kBrickEdge; ++y) {
      const auto* of = &bricks[static_cast<std::size_t>(9 * ((x + 8) >> 3) + 3 * ((y + 8) >> 3))];
      const int row = brick_offset(x & 7, y & 7, 0);
      around[at(x, y, -1)] = of[0][row + kBrickEdge - 1];
      std::copy_n(of[1] + row, kBrickEdge, &around[at(x, y, 0)]);
      around[at(x, y, kBrickEdge)] = of[2][row];
    }
}

// Eight voxels along z, the first in the first byte.
using Row = std::uint64_t;
static_assert(sizeof(Row) == kBrickEdge);

Row row_of(const std::uint8_t* voxels) {
  Row row;
  std::memcpy(&row, voxels, sizeof(row));
  return row;
}

bool has_zero(Row row) { return ((row - 0x0101010101010101) & ~row & 0x8080808080808080) != 0; }

// Of each row of the brick's voxels which of them, or of the 26 beside one, have a label.
void mark_near(const Around& around, std::array<Row, kBrickEdge * kBrickEdge>& near) {
  std::array<Row, kEdge * kBrickEdge> plane;
  for (int x = 0; x < kEdge; ++x) {
    std::array<Row, kEdge> row;
    for (int y = 0; y < kEdge; ++y) {
      const std::uint8_t* voxels = &around[at(x - 1, y - 1, -1)];
      row[y] = row_of(voxels) | row_of(voxels + 1) | row_of(voxels + 2);
    }
    for (int y = 0; y < kBrickEdge; ++y)
      plane[x * kBrickEdge + y] = row[y] | row[y + 1] | row[y + 2];
  }
  for (std::size_t i = 0; i < near.size(); ++i)
    near[i] = plane[i] | plane[i + kBrickEdge] | plane[i + 2 * kBrickEdge];
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
  std::array<Row, kBrickEdge * kBrickEdge> near;
  for (std::size_t b = 0; b < labels.table_size(); ++b) {
    if (solid.is_uniform(b)) continue;  // no surface within the band
    if (labels.is_uniform(b) && labels.uniform_value(b) != 0) continue;
    const std::uint8_t* here = labels.brick(b);
    const float* phi = solid.brick(b);
    look_around(labels, b, around);
    mark_near(around, near);
    std::uint8_t* target = nullptr;
    for (int v = 0; v < kBrickVoxels; v += kBrickEdge) {
      const Row marked = near[static_cast<std::size_t>(v / kBrickEdge)];
      if (marked == 0 || !has_zero(row_of(here + v))) continue;
      const auto has_near = std::bit_cast<std::array<std::uint8_t, kBrickEdge>>(marked);
      for (int z = 0; z < kBrickEdge; ++z) {
        if (here[v + z] != 0 || has_near[z] == 0 || phi[v + z] > reach) continue;
        const int middle = at(v >> 6, (v >> 3) & 7, z);
        const auto nearest = std::find_if(beside.begin(), beside.end(), [&](int offset) {
          return around[static_cast<std::size_t>(middle + offset)] != 0;
        });
        if (!target) target = extended.writable_brick(b);
        target[v + z] = around[static_cast<std::size_t>(middle + *nearest)];
      }
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
