// Marching cubes on the bricks of a level set, by the cases of step/tooth/cell_cases.h, which keep the
// promise: closed, 2-manifold, no triangle through another.
#include "toothprep/tools/mesh/surface.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <limits>
#include <memory>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/tooth/cell_cases.h"
#include "toothprep/step/tooth/tissue_under.h"

namespace toothprep {
namespace {

// ---- Samples of one brick and of the first layer of its upper neighbours: all that its cells
// touch.

constexpr int kSpan = kBrickEdge + 1;
using Samples = std::array<float, kSpan * kSpan * kSpan>;
constexpr int sample_offset(int x, int y, int z) { return (x * kSpan + y) * kSpan + z; }

// The bricks of a level set and one more layer at the lower sides, whose cells reach into it.
class Bricks {
 public:
  explicit Bricks(const LevelSet& grid)
      : grid_(grid), counts_(grid.brick_counts() + Index3::Ones()) {
    outside_.fill(grid.background());
  }
  std::size_t size() const { return counts_.cast<std::size_t>().prod(); }
  Index3 place(std::size_t index) const {  // -1 .. count - 1 each
    const auto z = static_cast<int>(index % counts_.z());
    const auto y = static_cast<int>(index / counts_.z() % counts_.y());
    const auto x = static_cast<int>(index / counts_.z() / counts_.y());
    return Index3(x - 1, y - 1, z - 1);
  }
  std::size_t index_of(const Index3& place) const {
    return (static_cast<std::size_t>(place.x() + 1) * counts_.y() + place.y() + 1) * counts_.z() +
           place.z() + 1;
  }
  Index3 first_voxel(const Index3& place) const {
    return (grid_.first_brick() + place) * kBrickEdge;
  }

  // False if all samples are known to lie on one side; else fills them.
  bool sample(const Index3& place, Samples& samples) const {
    std::array<const float*, 8> brick;
    bool inside = false, outside = false;
    for (int n = 0; n < 8; ++n) {
      const Index3 p = place + Index3(n >> 2, n >> 1 & 1, n & 1);
      brick[n] = outside_.data();
      if (p.minCoeff() >= 0 && (grid_.brick_counts() - p).minCoeff() > 0) {
        const std::size_t b = (static_cast<std::size_t>(p.x()) * grid_.brick_counts().y() + p.y()) *
                                  grid_.brick_counts().z() +
                              p.z();
        brick[n] = grid_.brick(b);
        if (!grid_.is_uniform(b)) inside = outside = true;
      }
      (brick[n][0] < 0 ? inside : outside) = true;
    }
    if (!inside || !outside) return false;
    for (int x = 0; x < kSpan; ++x)
      for (int y = 0; y < kSpan; ++y)
        for (int z = 0; z < kSpan; ++z)
          samples[sample_offset(x, y, z)] =
              brick[(x >> 3) << 2 | (y >> 3) << 1 | z >> 3][brick_offset(x & 7, y & 7, z & 7)];
    return true;
  }

 private:
  const LevelSet& grid_;
  Index3 counts_;
  std::array<float, kBrickVoxels> outside_;
};

// What one brick adds to the mesh: the crossed lattice edges that start in its voxels, and its
// cells' triangles. The vertices are numbered by brick, then by axis and voxel, whatever the
// threads do.
struct Part {
  std::array<std::uint64_t, 24> crossed{};  // bit axis * 512 + brick_offset
  std::array<std::uint16_t, 24> before{};   // crossed edges in earlier words
  std::uint32_t vertices = 0, triangles = 0;
  std::size_t first_vertex = 0, first_triangle = 0;

  std::size_t vertex(int axis, int x, int y, int z) const {
    const int bit = axis * kBrickVoxels + brick_offset(x, y, z);
    const std::uint64_t below = crossed[bit >> 6] & ((std::uint64_t{1} << (bit & 63)) - 1);
    return first_vertex + before[bit >> 6] + static_cast<std::size_t>(std::popcount(below));
  }
};

std::array<float, 8> corners_of(const Samples& samples, int x, int y, int z) {
  std::array<float, 8> corners;
  for (int c = 0; c < 8; ++c)
    corners[c] = samples[sample_offset(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2))];
  return corners;
}

int case_of(const Samples& samples, int x, int y, int z) {
  int inside = 0;
  for (int c = 0; c < 8; ++c)
    inside |= (samples[sample_offset(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2))] < 0) << c;
  return inside;
}

std::unique_ptr<Part> count_part(const Samples& samples, const CellCases& cases) {
  Part part;
  for (int x = 0; x < kBrickEdge; ++x)
    for (int y = 0; y < kBrickEdge; ++y)
      for (int z = 0; z < kBrickEdge; ++z) {
        const int inside = case_of(samples, x, y, z);
        if (inside == 0 || inside == 255) continue;
        part.triangles += static_cast<std::uint32_t>(cases.cases[inside].triangles);
        for (int axis = 0; axis < 3; ++axis)
          if ((inside ^ inside >> (1 << axis)) & 1) {
            const int bit = axis * kBrickVoxels + brick_offset(x, y, z);
            part.crossed[bit >> 6] |= std::uint64_t{1} << (bit & 63);
          }
      }
  if (part.triangles == 0) return nullptr;
  for (std::size_t word = 0; word < part.crossed.size(); ++word) {
    part.before[word] = static_cast<std::uint16_t>(part.vertices);
    part.vertices += static_cast<std::uint32_t>(std::popcount(part.crossed[word]));
  }
  return std::make_unique<Part>(part);
}

}  // namespace

TriangleMesh extract_surface(const LayeredTooth& tooth, SurfaceOf what) {
  const CellCases& cases = cell_cases();
  const LevelSet tissue = what == SurfaceOf::kAll
                              ? LevelSet()
                              : tooth.remains[static_cast<std::size_t>(what) - 1].unpacked();
  const LevelSet& grid = what == SurfaceOf::kAll ? tooth.solid : tissue;
  const Bricks bricks(grid);
  std::vector<std::unique_ptr<Part>> parts(bricks.size());
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t b) {
    Samples samples;
    if (bricks.sample(bricks.place(b), samples)) parts[b] = count_part(samples, cases);
  });
  std::size_t vertices = 0, triangles = 0;
  for (const auto& part : parts) {
    if (!part) continue;
    part->first_vertex = vertices;
    part->first_triangle = triangles;
    vertices += part->vertices;
    triangles += part->triangles;
  }
  if (std::max(vertices, triangles) > std::numeric_limits<std::int32_t>::max())
    throw Error("the surface has " + std::to_string(triangles) +
                " triangles, more than a mesh file can number; use a larger voxel size");

  TriangleMesh mesh;
  mesh.vertices.resize(vertices);
  mesh.tissue.resize(vertices);
  mesh.triangles.resize(triangles);
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t b) {
    if (!parts[b]) return;
    const Part& part = *parts[b];
    const Index3 place = bricks.place(b), first = bricks.first_voxel(place);
    Samples samples;
    bricks.sample(place, samples);
    for (std::size_t word = 0; word < part.crossed.size(); ++word) {
      std::size_t vertex = part.first_vertex + part.before[word];
      for (std::uint64_t bits = part.crossed[word]; bits != 0; bits &= bits - 1, ++vertex) {
        const int bit = static_cast<int>(word) * 64 + std::countr_zero(bits);
        const int axis = bit / kBrickVoxels, x = bit >> 6 & 7, y = bit >> 3 & 7, z = bit & 7;
        const Index3 step = Index3::Unit(axis);
        const double a = samples[sample_offset(x, y, z)];
        const double c = samples[sample_offset(x + step.x(), y + step.y(), z + step.z())];
        const double t = crossing_on_edge(a, c);
        const Index3 voxel = first + Index3(x, y, z);
        const Vec3 at = voxel.cast<double>() + t * Vec3::Unit(axis);
        mesh.vertices[vertex] = (tooth.lattice.origin + tooth.lattice.voxel * at).cast<float>();
        mesh.tissue[vertex] = what != SurfaceOf::kAll ? static_cast<std::uint8_t>(what)
                              : a < 0                 ? tissue_under(tooth, voxel, voxel + step, t)
                                      : tissue_under(tooth, voxel + step, voxel, 1 - t);
      }
    }
    std::size_t triangle = part.first_triangle;
    for (int x = 0; x < kBrickEdge; ++x)
      for (int y = 0; y < kBrickEdge; ++y)
        for (int z = 0; z < kBrickEdge; ++z) {
          const CellCase& cell = cases.cases[case_of(samples, x, y, z)];
          for (int l = 0; l < cell.loops; ++l) {
            const CellLoop& loop = cell.loop[l];
            std::array<std::uint32_t, 7> corner;
            for (int i = 0; i < loop.size; ++i) {
              const CellEdge& edge = cases.edges[loop.edge[i]];
              const int ex = x + (edge.base & 1), ey = y + (edge.base >> 1 & 1),
                        ez = z + (edge.base >> 2);
              const Part& owner =
                  *parts[bricks.index_of(place + Index3(ex >> 3, ey >> 3, ez >> 3))];
              corner[i] =
                  static_cast<std::uint32_t>(owner.vertex(edge.axis, ex & 7, ey & 7, ez & 7));
            }
            const int best = fan_apex(loop, corners_of(samples, x, y, z));
            for (int d = 1; d < loop.size - 1; ++d)
              mesh.triangles[triangle++] = {corner[best], corner[(best + d) % loop.size],
                                            corner[(best + d + 1) % loop.size]};
          }
        }
  });
  return mesh;
}

double mesh_volume_mm3(const TriangleMesh& mesh) {
  if (mesh.vertices.empty()) return 0;
  // About a vertex of the mesh, so that a tooth far from the origin loses no digits.
  const Vec3 about = mesh.vertices[0].cast<double>();
  double six_volumes = 0;
  for (const auto& t : mesh.triangles) {
    const Vec3 a = mesh.vertices[t[0]].cast<double>() - about;
    const Vec3 b = mesh.vertices[t[1]].cast<double>() - about;
    const Vec3 c = mesh.vertices[t[2]].cast<double>() - about;
    six_volumes += a.dot(b.cross(c));
  }
  return six_volumes / 6;
}

}  // namespace toothprep
