// Marching cubes on the bricks of a level set.
//
// What a mesh for printing, scoring and collision needs is a promise: closed, 2-manifold, no
// triangle through another. The usual case table with an arbitrary triangulation does not give it,
// so the cases are derived here from three rules:
//  1. On a cell's face, cuts separate the inside corners. The rule looks at the face only, so both
//  cells of
//     a face draw the same segments: the surface closes, each vertex sits in one loop per cell.
//  2. A loop is filled by a fan none of whose diagonals lies in a face of the cell. So what two
//  cells
//     share is the segments of rule 1 and nothing else.
//  3. A vertex keeps away from the ends of its edge (kEdgeMargin), so no triangle is degenerate.
// Every loop has such a fan, and for every case the fans neither cross themselves nor each other
// wherever the vertices lie on their edges; tests/mesh checks it on noise, where all cases occur,
// with CGAL.
#include "toothprep/mesh/surface.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <limits>
#include <memory>
#include <utility>

#include "toothprep/core/errors.h"

namespace toothprep {
namespace {

// A crossing stays this part of an edge away from its ends. It moves the surface by at most 2 % of
// a voxel (2 µm at 0.1 mm), and only where it passes so close to a voxel's centre.
constexpr double kEdgeMargin = 0.02;

// ---- The cases. Corner c of a cell has the coordinates (c & 1, c >> 1 & 1, c >> 2 & 1); a case is
// the set of its corners that lie inside, as bits.

struct CellEdge {
  int axis = 0, base = 0;  // runs from corner `base` along `axis`
};
struct Loop {
  int size = 0;
  std::array<std::uint8_t, 7> edge{};  // counter-clockwise seen from outside the solid
  std::uint8_t apexes = 0;             // bits: corners of the loop from which it may be fanned
};
struct CellCase {
  int loops = 0, triangles = 0;
  std::array<Loop, 4> loop;
};
struct Cases {
  std::array<CellEdge, 12> edges;
  std::array<CellCase, 256> cases;
};

bool on_one_face(const CellEdge& e, const CellEdge& f) {
  for (int axis = 0; axis < 3; ++axis)
    if (axis != e.axis && axis != f.axis && ((e.base ^ f.base) >> axis & 1) == 0) return true;
  return false;
}

Cases derive_cases() {
  Cases all;
  std::array<std::array<int, 8>, 8> edge_between{};
  int count = 0;
  for (int axis = 0; axis < 3; ++axis)
    for (int c = 0; c < 8; ++c)
      if ((c >> axis & 1) == 0) {
        edge_between[c][c | 1 << axis] = edge_between[c | 1 << axis][c] = count;
        all.edges[count++] = {axis, c};
      }
  for (int inside = 1; inside < 255; ++inside) {
    // Each face's segments, as a map from the edge where one starts to the edge where it ends.
    // Walking the corners of a face counter-clockwise seen from outside the cell, a run of inside
    // corners is entered over one edge and left over another: that is rule 1's segment.
    std::array<int, 12> next;
    next.fill(-1);
    for (int axis = 0; axis < 3; ++axis)
      for (int side = 0; side < 2; ++side) {
        const int u = 1 << (axis + 1) % 3, v = 1 << (axis + 2) % 3, base = side << axis;
        std::array<int, 4> corner = {base, base | u, base | u | v, base | v};
        if (side == 0) std::swap(corner[1], corner[3]);
        const auto is_inside = [&](int i) { return (inside >> corner[i % 4] & 1) != 0; };
        for (int i = 0; i < 4; ++i) {
          if (is_inside(i) || !is_inside(i + 1)) continue;
          int last = i + 1;
          while (is_inside(last + 1)) ++last;
          next[edge_between[corner[i]][corner[(i + 1) % 4]]] =
              edge_between[corner[last % 4]][corner[(last + 1) % 4]];
        }
      }
    CellCase& cell = all.cases[inside];
    for (int start = 0; start < 12; ++start) {
      if (next[start] < 0) continue;
      Loop& loop = cell.loop[cell.loops++];
      for (int e = start; next[e] >= 0;) {
        loop.edge[loop.size++] = static_cast<std::uint8_t>(e);
        e = std::exchange(next[e], -1);
      }
      for (int apex = 0; apex < loop.size; ++apex) {
        bool free_of_faces = true;
        for (int d = 2; d < loop.size - 1; ++d)
          free_of_faces &= !on_one_face(all.edges[loop.edge[apex]],
                                        all.edges[loop.edge[(apex + d) % loop.size]]);
        if (free_of_faces) loop.apexes = static_cast<std::uint8_t>(loop.apexes | 1 << apex);
      }
      cell.triangles += loop.size - 2;
    }
  }
  return all;
}

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

int case_of(const Samples& samples, int x, int y, int z) {
  int inside = 0;
  for (int c = 0; c < 8; ++c)
    inside |= (samples[sample_offset(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2))] < 0) << c;
  return inside;
}

std::unique_ptr<Part> count_part(const Samples& samples, const Cases& cases) {
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

// Offsets to the voxels around one, nearest first (ties in a fixed order).
std::vector<Index3> nearest_offsets(int reach) {
  std::vector<Index3> offsets;
  for (int x = -reach; x <= reach; ++x)
    for (int y = -reach; y <= reach; ++y)
      for (int z = -reach; z <= reach; ++z) offsets.emplace_back(x, y, z);
  std::stable_sort(offsets.begin(), offsets.end(), [](const Index3& a, const Index3& b) {
    return a.squaredNorm() < b.squaredNorm();
  });
  return offsets;
}

std::uint8_t label_near(const LabelGrid& labels, const Index3& voxel) {
  static const std::vector<Index3> kOffsets = nearest_offsets(2);
  for (const Index3& o : kOffsets) {
    const Index3 i = voxel + o;
    if (const std::uint8_t label = labels.value(i.x(), i.y(), i.z())) return label;
  }
  return static_cast<std::uint8_t>(Tissue::kOther);
}

// The tissue under a point of the surface, `s` of the way from the voxel inside to the one outside.
// The tissues' own level sets place their border within a voxel, where enamel thins out for one.
std::uint8_t tissue_under(const LayeredTooth& tooth, const Index3& inside, const Index3& outside,
                          double s) {
  if (tooth.tissue.value(inside.x(), inside.y(), inside.z()) !=
      static_cast<std::uint8_t>(Tissue::kOther)) {  // which has no level set of its own
    int nearest = 0;
    double least = tooth.lattice.voxel / 2;
    for (int k = 0; k < 3; ++k) {
      const double a = tooth.remains[k].value(inside.x(), inside.y(), inside.z());
      const double b = tooth.remains[k].value(outside.x(), outside.y(), outside.z());
      const double phi = (1 - s) * a + s * b;
      if (phi < least) {
        least = phi;
        nearest = k + 1;
      }
    }
    if (nearest > 0) return static_cast<std::uint8_t>(nearest);
  }
  return label_near(tooth.tissue, inside);
}

}  // namespace

TriangleMesh extract_surface(const LayeredTooth& tooth, SurfaceOf what) {
  static const Cases kCases = derive_cases();
  const LevelSet& grid =
      what == SurfaceOf::kAll ? tooth.solid : tooth.remains[static_cast<int>(what) - 1];
  const Bricks bricks(grid);
  std::vector<std::unique_ptr<Part>> parts(bricks.size());
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t b) {
    Samples samples;
    if (bricks.sample(bricks.place(b), samples)) parts[b] = count_part(samples, kCases);
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
        const double t = std::clamp(a / (a - c), kEdgeMargin, 1 - kEdgeMargin);
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
          const CellCase& cell = kCases.cases[case_of(samples, x, y, z)];
          for (int l = 0; l < cell.loops; ++l) {
            const Loop& loop = cell.loop[l];
            std::array<std::uint32_t, 7> corner;
            for (int i = 0; i < loop.size; ++i) {
              const CellEdge& edge = kCases.edges[loop.edge[i]];
              const int ex = x + (edge.base & 1), ey = y + (edge.base >> 1 & 1),
                        ez = z + (edge.base >> 2);
              const Part& owner =
                  *parts[bricks.index_of(place + Index3(ex >> 3, ey >> 3, ez >> 3))];
              corner[i] =
                  static_cast<std::uint32_t>(owner.vertex(edge.axis, ex & 7, ey & 7, ez & 7));
            }
            // Of the allowed fans the one with the shortest diagonals, the first of equals.
            const auto position = [&](int i) {
              const CellEdge& edge = kCases.edges[loop.edge[i % loop.size]];
              const int ex = x + (edge.base & 1), ey = y + (edge.base >> 1 & 1),
                        ez = z + (edge.base >> 2);
              const Index3 step = Index3::Unit(edge.axis);
              const double a = samples[sample_offset(ex, ey, ez)];
              const double c = samples[sample_offset(ex + step.x(), ey + step.y(), ez + step.z())];
              return Vec3(Vec3(ex, ey, ez) + a / (a - c) * Vec3::Unit(edge.axis));
            };
            int best = 0;
            double shortest = std::numeric_limits<double>::infinity();
            for (int apex = 0; loop.size > 3 && apex < loop.size; ++apex) {
              if ((loop.apexes >> apex & 1) == 0) continue;
              double length = 0;
              for (int d = 2; d < loop.size - 1; ++d)
                length += (position(apex) - position(apex + d)).squaredNorm();
              if (length < shortest - 1e-9) {
                shortest = length;
                best = apex;
              }
            }
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
