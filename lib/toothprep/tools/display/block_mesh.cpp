#include "toothprep/tools/display/block_mesh.h"

#include <algorithm>
#include <array>
#include <bit>
#include <unordered_map>

#include "toothprep/step/tooth/cell_cases.h"
#include "toothprep/step/tooth/tissue_under.h"

namespace toothprep {
namespace {

constexpr int kSpan = kBlockCells + 1;  // samples of a block per axis
constexpr int kWindow = kSpan + 2;      // and one more on every side, for the gradients
constexpr int kStrideX = kWindow * kWindow, kStrideY = kWindow;

// Sample (x, y, z) of a block, -1 .. 33 each.
constexpr int sample_offset(int x, int y, int z) {
  return (x + 1) * kStrideX + (y + 1) * kStrideY + z + 1;
}

int floor_div(int a, int b) { return a >= 0 ? a / b : -((b - 1 - a) / b); }

// A bit for each of the samples z = 0 .. 32 along a row.
using RowBits = std::uint64_t;
constexpr RowBits kCells = (RowBits{1} << kBlockCells) - 1, kSamples = (RowBits{1} << kSpan) - 1;

}  // namespace

BlockRange blocks_of(const LevelSet& grid) {
  // Cells from one voxel before the grid to its last voxel; what lies outside is air.
  BlockRange range;
  for (int a = 0; a < 3; ++a) {
    const int first = grid.first_brick()[a] * kBrickEdge;
    const int last = first + grid.brick_counts()[a] * kBrickEdge - 1;
    range.first[a] = floor_div(first - 1, kBlockCells);
    range.counts[a] = floor_div(last, kBlockCells) - range.first[a] + 1;
  }
  return range;
}

BlockRange blocks_touched(const BlockRange& all, const Index3& lower, const Index3& upper) {
  // Block b reads the samples 32 b - 1 .. 32 b + 33.
  BlockRange range;
  for (int a = 0; a < 3; ++a) {
    const int first = std::max(all.first[a], floor_div(lower[a] - 2, kBlockCells));
    const int last =
        std::min(all.first[a] + all.counts[a] - 1, floor_div(upper[a] + 1, kBlockCells));
    if (last < first) return {};
    range.first[a] = first;
    range.counts[a] = last - first + 1;
  }
  return range;
}

struct BlockMesher::Work {
  std::array<float, kWindow * kWindow * kWindow> samples;
  std::array<RowBits, kSpan * kSpan> inside;
  // Crossed lattice edges from the samples of a row, by axis, and the number of the first of them.
  struct Row {
    std::array<RowBits, 3> crossed;
    std::array<std::uint32_t, 3> first;
  };
  std::array<Row, kSpan * kSpan> rows;

  bool take_samples(const LevelSet& solid, const LevelSet& cut, const Index3& first);
  std::uint32_t find_crossings();
  std::uint32_t vertex(int axis, int x, int y, int z) const {
    const Row& row = rows[x * kSpan + y];
    const RowBits below = row.crossed[axis] & ((RowBits{1} << z) - 1);
    return row.first[axis] + static_cast<std::uint32_t>(std::popcount(below));
  }
  Eigen::Vector3f gradient(int offset) const {
    const float* f = samples.data() + offset;
    return {f[kStrideX] - f[-kStrideX], f[kStrideY] - f[-kStrideY], f[1] - f[-1]};
  }
  void place_vertices(const LayeredTooth& tooth, const Index3& first, BlockMesh& result) const;
  void place_triangles(BlockMesh& result) const;
};

BlockMesher::BlockMesher() : work_(std::make_unique<Work>()) {}
BlockMesher::~BlockMesher() = default;
BlockMesher::BlockMesher(BlockMesher&&) noexcept = default;

// The window's samples of max(solid, cut); false, with the samples unset, if all of them are known
// to lie on one side. `first`: the block's first voxel.
bool BlockMesher::Work::take_samples(const LevelSet& solid, const LevelSet& cut,
                                     const Index3& first) {
  constexpr int kMost = kWindow / kBrickEdge + 2;  // bricks along an axis
  struct Source {
    const float *solid, *cut;
  };
  std::array<Source, kMost * kMost * kMost> sources;
  std::array<float, kBrickVoxels> outside_solid, outside_cut;
  outside_solid.fill(solid.background());
  outside_cut.fill(cut.background());
  const Index3 lower = first - Index3::Ones(), upper = first + Index3::Constant(kSpan);
  const Index3 brick0(lower.x() >> 3, lower.y() >> 3, lower.z() >> 3);
  const Index3 brick1(upper.x() >> 3, upper.y() >> 3, upper.z() >> 3);

  bool any_inside = false, any_outside = false;
  std::size_t n = 0;
  for (int bx = brick0.x(); bx <= brick1.x(); ++bx)
    for (int by = brick0.y(); by <= brick1.y(); ++by)
      for (int bz = brick0.z(); bz <= brick1.z(); ++bz, ++n) {
        const std::int64_t b = solid.brick_index(8 * bx, 8 * by, 8 * bz);
        if (b < 0) {
          sources[n] = {outside_solid.data(), outside_cut.data()};
          any_outside = true;
          continue;
        }
        const auto i = static_cast<std::size_t>(b);
        sources[n] = {solid.brick(i), cut.brick(i)};
        const bool air = (solid.is_uniform(i) && solid.uniform_value(i) >= 0) ||
                         (cut.is_uniform(i) && cut.uniform_value(i) >= 0);
        const bool full = !air && solid.is_uniform(i) && cut.is_uniform(i);
        any_outside = any_outside || !full;
        any_inside = any_inside || !air;
      }
  if (!any_inside || !any_outside) return false;

  n = 0;
  for (int bx = brick0.x(); bx <= brick1.x(); ++bx)
    for (int by = brick0.y(); by <= brick1.y(); ++by)
      for (int bz = brick0.z(); bz <= brick1.z(); ++bz, ++n) {
        const Index3 low = Index3(8 * bx, 8 * by, 8 * bz).cwiseMax(lower);
        const Index3 high = Index3(8 * bx + 7, 8 * by + 7, 8 * bz + 7).cwiseMin(upper);
        const int count = high.z() - low.z() + 1;
        for (int x = low.x(); x <= high.x(); ++x)
          for (int y = low.y(); y <= high.y(); ++y) {
            const int from = brick_offset(x & 7, y & 7, low.z() & 7);
            const float *s = sources[n].solid + from, *c = sources[n].cut + from;
            float* to =
                samples.data() + sample_offset(x - first.x(), y - first.y(), low.z() - first.z());
            for (int z = 0; z < count; ++z) to[z] = std::max(s[z], c[z]);
          }
      }
  return true;
}

// The number of crossed edges.
std::uint32_t BlockMesher::Work::find_crossings() {
  for (int x = 0; x < kSpan; ++x)
    for (int y = 0; y < kSpan; ++y) {
      const float* row = samples.data() + sample_offset(x, y, 0);
      RowBits bits = 0;
      for (int z = 0; z < kSpan; ++z) bits |= static_cast<RowBits>(row[z] < 0) << z;
      inside[x * kSpan + y] = bits;
    }
  std::uint32_t vertices = 0;
  for (int x = 0; x < kSpan; ++x)
    for (int y = 0; y < kSpan; ++y) {
      const RowBits here = inside[x * kSpan + y];
      Row& row = rows[x * kSpan + y];
      row.crossed[0] = x < kBlockCells ? (here ^ inside[(x + 1) * kSpan + y]) & kSamples : 0;
      row.crossed[1] = y < kBlockCells ? (here ^ inside[x * kSpan + y + 1]) & kSamples : 0;
      row.crossed[2] = (here ^ here >> 1) & kCells;
      for (int axis = 0; axis < 3; ++axis) {
        row.first[axis] = vertices;
        vertices += static_cast<std::uint32_t>(std::popcount(row.crossed[axis]));
      }
    }
  return vertices;
}

void BlockMesher::Work::place_vertices(const LayeredTooth& tooth, const Index3& first,
                                       BlockMesh& result) const {
  constexpr std::array<int, 3> kStride = {kStrideX, kStrideY, 1};
  DisplayMesh& mesh = result.mesh;
  std::size_t n = 0;
  for (int x = 0; x < kSpan; ++x)
    for (int y = 0; y < kSpan; ++y)
      for (int axis = 0; axis < 3; ++axis)
        for (RowBits bits = rows[x * kSpan + y].crossed[axis]; bits != 0; bits &= bits - 1, ++n) {
          const int z = std::countr_zero(bits);
          const int from = sample_offset(x, y, z), to = from + kStride[axis];
          const float a = samples[from], b = samples[to];
          const double t = crossing_on_edge(a, b);
          const Index3 voxel = first + Index3(x, y, z), next = voxel + Index3::Unit(axis);
          const Vec3 at = voxel.cast<double>() + t * Vec3::Unit(axis);
          mesh.vertices[n] = (tooth.lattice.origin + tooth.lattice.voxel * at).cast<float>();
          mesh.tissue[n] = a < 0 ? tissue_under(tooth, voxel, next, t, a, b)
                                 : tissue_under(tooth, next, voxel, 1 - t, b, a);
          const auto s = static_cast<float>(t);
          Eigen::Vector3f normal = (1 - s) * gradient(from) + s * gradient(to);
          const float length = normal.norm();
          // A wall of one voxel can have no gradient; the edge itself leads outward.
          mesh.normals[n] = length > 0
                                ? Eigen::Vector3f(normal / length)
                                : Eigen::Vector3f((a < 0 ? 1 : -1) * Eigen::Vector3f::Unit(axis));
          result.edge[n] = static_cast<std::uint32_t>(((x * kSpan + y) * kSpan + z) * 3 + axis);
        }
}

void BlockMesher::Work::place_triangles(BlockMesh& result) const {
  const CellCases& cases = cell_cases();
  for (int x = 0; x < kBlockCells; ++x)
    for (int y = 0; y < kBlockCells; ++y) {
      const std::array<RowBits, 4> row = {inside[x * kSpan + y], inside[(x + 1) * kSpan + y],
                                          inside[x * kSpan + y + 1],
                                          inside[(x + 1) * kSpan + y + 1]};
      const RowBits any = row[0] | row[1] | row[2] | row[3];
      const RowBits all = row[0] & row[1] & row[2] & row[3];
      for (RowBits cells = (any | any >> 1) & ~(all & all >> 1) & kCells; cells != 0;
           cells &= cells - 1) {
        const int z = std::countr_zero(cells);
        unsigned inside_corners = 0;
        for (int c = 0; c < 4; ++c) {
          inside_corners |= static_cast<unsigned>(row[c] >> z & 1) << c;
          inside_corners |= static_cast<unsigned>(row[c] >> (z + 1) & 1) << (c + 4);
        }
        const CellCase& cell = cases.cases[inside_corners];
        for (int l = 0; l < cell.loops; ++l) {
          const CellLoop& loop = cell.loop[l];
          std::array<std::uint32_t, 7> corner;
          for (int i = 0; i < loop.size; ++i) {
            const CellEdge& edge = cases.edges[loop.edge[i]];
            corner[i] = vertex(edge.axis, x + (edge.base & 1), y + (edge.base >> 1 & 1),
                               z + (edge.base >> 2));
          }
          int apex = 0;
          if (loop.size > 3) {
            std::array<float, 8> values;
            for (int c = 0; c < 8; ++c)
              values[c] = samples[sample_offset(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2))];
            apex = fan_apex(loop, values);
          }
          for (int d = 1; d < loop.size - 1; ++d)
            result.mesh.triangles.push_back(
                {corner[apex], corner[(apex + d) % loop.size], corner[(apex + d + 1) % loop.size]});
        }
      }
    }
}

BlockMesh BlockMesher::mesh(const LayeredTooth& tooth, const LevelSet& cut, const Index3& block) {
  BlockMesh result;
  result.block = block;
  const Index3 first = block * kBlockCells;
  if (!work_->take_samples(tooth.solid, cut, first)) return result;
  const std::uint32_t vertices = work_->find_crossings();
  if (vertices == 0) return result;
  result.mesh.vertices.resize(vertices);
  result.mesh.normals.resize(vertices);
  result.mesh.tissue.resize(vertices);
  result.edge.resize(vertices);
  work_->place_vertices(tooth, first, result);
  result.mesh.triangles.reserve(2 * std::size_t{vertices});
  work_->place_triangles(result);
  return result;
}

DisplayMesh join_blocks(const std::vector<std::shared_ptr<const BlockMesh>>& blocks) {
  DisplayMesh joined;
  std::size_t vertices = 0, triangles = 0;
  for (const auto& b : blocks) {
    vertices += b->mesh.vertices.size();
    triangles += b->mesh.triangles.size();
  }
  joined.vertices.reserve(vertices);
  joined.normals.reserve(vertices);
  joined.tissue.reserve(vertices);
  joined.triangles.reserve(triangles);

  // Vertices in planes that blocks share, by their lattice edge.
  struct Edge {
    int x, y, z, axis;
    bool operator==(const Edge&) const = default;
  };
  const auto hash = [](const Edge& e) {
    std::uint64_t h = static_cast<std::uint32_t>(e.x);
    for (const int part : {e.y, e.z, e.axis})
      h = (h ^ static_cast<std::uint32_t>(part)) * 0x9E3779B97F4A7C15ull, h ^= h >> 29;
    return static_cast<std::size_t>(h);
  };
  std::unordered_map<Edge, std::uint32_t, decltype(hash)> shared(vertices / 8 + 16, hash);
  std::vector<std::uint32_t> number;
  for (const auto& b : blocks) {
    const DisplayMesh& mesh = b->mesh;
    number.resize(mesh.vertices.size());
    for (std::size_t v = 0; v < number.size(); ++v) {
      const auto at = static_cast<int>(b->edge[v]);
      const int axis = at % 3, z = at / 3 % kSpan, y = at / 3 / kSpan % kSpan,
                x = at / 3 / kSpan / kSpan;
      const auto next = static_cast<std::uint32_t>(joined.vertices.size());
      number[v] = next;
      if (x % kBlockCells == 0 || y % kBlockCells == 0 || z % kBlockCells == 0) {
        const Index3 voxel = b->block * kBlockCells + Index3(x, y, z);
        number[v] = shared.try_emplace({voxel.x(), voxel.y(), voxel.z(), axis}, next).first->second;
        if (number[v] != next) continue;
      }
      joined.vertices.push_back(mesh.vertices[v]);
      joined.normals.push_back(mesh.normals[v]);
      joined.tissue.push_back(mesh.tissue[v]);
    }
    for (const auto& t : mesh.triangles)
      joined.triangles.push_back({number[t[0]], number[t[1]], number[t[2]]});
  }
  return joined;
}

}  // namespace toothprep
