#include "toothprep/tools/mesh/sharp_surface.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/tooth/tissue_under.h"

namespace toothprep {
namespace {

// No sample is nearer to zero than this part of a voxel, so that no vertex coincides with a voxel's
// centre; nor are the fields nearer to one another (a cut that follows the tooth's own surface
// leaves that surface) or to one another's opposite (a wall that is thinner is no wall). It moves
// the surfaces by no more than that and twice that.
constexpr float kLeastVoxels = 0.005F;

constexpr int kFaceCodes = 14;  // codes below are of edges: direction - 1, and 7 more for g
constexpr std::uint64_t kCodes = 64;

Index3 corner_offset(int corner) { return Index3(corner & 1, corner >> 1 & 1, corner >> 2 & 1); }

// The six tetrahedra of a cell run along its edges from corner 0 to corner 7, an axis after another.
// Corners are bit masks as in step/tooth/cell_cases.h; each holds the one before.
struct Tetrahedron {
  std::array<int, 4> corner;
  bool positive;  // its corners turn right-handed
};
constexpr std::array<Tetrahedron, 6> kTetrahedra = {{{{0, 1, 3, 7}, true},
                                                     {{0, 2, 6, 7}, true},
                                                     {{0, 4, 5, 7}, true},
                                                     {{0, 2, 3, 7}, false},
                                                     {{0, 1, 5, 7}, false},
                                                     {{0, 4, 6, 7}, false}}};

// Both fields, mm. Index 0 is f, 1 is g.
class Fields {
 public:
  explicit Fields(const LayeredTooth& tooth)
      : intact_(tooth.parts->intact),
        cut_(tooth.parts->cut),
        least_(kLeastVoxels * static_cast<float>(tooth.lattice.voxel)) {}
  std::array<float, 2> at(const Index3& i) const {
    const float f = kept_away(intact_.value(i.x(), i.y(), i.z()));
    const float g = -cut_.value(i.x(), i.y(), i.z());
    return {f, kept_away(std::abs(g - f) < least_   ? f - least_
                         : std::abs(g + f) < least_ ? least_ - f
                                                    : g)};
  }
  // Bricks along each axis, with one more layer at the lower sides, whose cells reach into the box.
  Index3 brick_counts() const { return intact_.brick_counts() + Index3::Ones(); }
  Index3 first_voxel() const { return (intact_.first_brick() - Index3::Ones()) * kBrickEdge; }
  // Whether the surface can pass through a cell that starts in the brick: not if a field is known to
  // be positive in it and its upper neighbours, or both to be negative.
  bool may_pass(const Index3& first) const {
    bool f_out = true, g_out = true, inside = true;
    for (int n = 0; n < 8; ++n) {
      const Index3 i = first + kBrickEdge * corner_offset(n);
      const std::optional<float> f = uniform(intact_, i), g = uniform(cut_, i);
      f_out = f_out && f && *f > 0;
      g_out = g_out && g && *g < 0;
      inside = inside && f && *f < 0 && g && *g > 0;
    }
    return !f_out && !g_out && !inside;
  }

 private:
  float kept_away(float v) const {
    return std::abs(v) < least_ ? std::copysign(least_, v < 0 ? -1.0F : 1.0F) : v;
  }
  static std::optional<float> uniform(const LevelSet& grid, const Index3& i) {
    const std::int64_t b = grid.brick_index(i.x(), i.y(), i.z());
    if (b < 0) return grid.background();
    if (!grid.is_uniform(static_cast<std::size_t>(b))) return std::nullopt;
    return grid.uniform_value(static_cast<std::size_t>(b));
  }
  const LevelSet &intact_, &cut_;
  float least_;
};

// Vertices are named by a voxel, counted from the box's lower corner, and a code: of the edge from
// there that crosses a field, or of the face from there on which both are zero.
class Names {
 public:
  explicit Names(const Fields& fields)
      : first_(fields.first_voxel()),
        counts_(fields.brick_counts() * kBrickEdge + Index3::Ones()) {}
  std::uint64_t of_edge(const Index3& cell, int from, int to, int field) const {
    return name(cell + corner_offset(from), (to ^ from) - 1 + 7 * field);
  }
  std::uint64_t of_face(const Index3& cell, int a, int b, int c) const {
    return name(cell + corner_offset(a), kFaceCodes + 7 * ((b ^ a) - 1) + (c ^ b) - 1);
  }
  Index3 voxel(std::uint64_t name) const {
    const std::uint64_t v = name / kCodes, y = static_cast<std::uint64_t>(counts_.y()),
                        z = static_cast<std::uint64_t>(counts_.z());
    return first_ + Index3(static_cast<int>(v / (y * z)), static_cast<int>(v / z % y),
                           static_cast<int>(v % z));
  }

 private:
  std::uint64_t name(const Index3& voxel, int code) const {
    const Index3 i = voxel - first_;
    return ((static_cast<std::uint64_t>(i.x()) * counts_.y() + i.y()) * counts_.z() + i.z()) *
               kCodes +
           static_cast<std::uint64_t>(code);
  }
  Index3 first_, counts_;
};

// What one brick's cells add.
struct Piece {
  std::vector<std::array<std::uint64_t, 3>> triangles;
  std::vector<std::array<std::uint64_t, 2>> margin;
};

struct Edge {  // of a tetrahedron: corners in its order, from < to
  int from, to;
};

// The loop of edges that one field crosses, counter-clockwise seen from its positive side.
struct Loop {
  int size = 0;
  std::array<Edge, 4> edge{};
};

Edge edge_of(int a, int b) { return {std::min(a, b), std::max(a, b)}; }

Loop loop_of(const std::array<bool, 4>& negative, bool positive_tetrahedron) {
  std::array<int, 4> in{}, out{};
  int ins = 0, outs = 0;
  for (int c = 0; c < 4; ++c) negative[c] ? in[ins++] = c : out[outs++] = c;
  Loop loop;
  bool turned = !positive_tetrahedron;
  if (ins == 2) {
    loop = {4,
            {edge_of(in[0], out[0]), edge_of(in[0], out[1]), edge_of(in[1], out[1]),
             edge_of(in[1], out[0])}};
    turned ^= in[0] + 2 == in[1];  // 02 | 13 and 13 | 02 are odd permutations
  } else if (ins == 1 || ins == 3) {
    const int alone = ins == 1 ? in[0] : out[0];
    const std::array<int, 4>& others = ins == 1 ? out : in;
    loop = {3,
            {edge_of(alone, others[0]), edge_of(alone, others[1]), edge_of(alone, others[2]), {}}};
    turned ^= (alone & 1) != (ins == 3);
  }
  if (turned) std::reverse(loop.edge.begin(), loop.edge.begin() + loop.size);
  return loop;
}

// Both fields at a tetrahedron's corners.
struct Corners {
  std::array<std::array<float, 4>, 2> value;
  std::array<std::array<bool, 4>, 2> negative;

  // Of an edge that both fields cross: whether f does so before g, from its first end. The products
  // of two floats are exact in double precision.
  bool f_first(const Edge& e) const {
    const auto product = [](float a, float b) {
      return std::abs(static_cast<double>(a) * static_cast<double>(b));
    };
    const double f = product(value[0][e.from], value[1][e.to]),
                 g = product(value[1][e.from], value[0][e.to]);
    return f == g ? value[1][e.from] > 0 : f < g;  // a tie as if g were a little larger
  }
  // Whether the other field is negative where `field` crosses the edge.
  bool other_negative(int field, const Edge& e) const {
    const std::array<bool, 4>& other = negative[1 - field];
    if (other[e.from] == other[e.to]) return other[e.from];
    const bool before = f_first(e) == (field == 0);  // of the other's crossing
    return other[before ? e.from : e.to];
  }
};

// The polygon of one field's zero, clipped by the other.
void add_polygon(const Index3& cell, const Tetrahedron& t, const Corners& s, int field,
                 const Names& names, Piece& piece) {
  const Loop loop = loop_of(s.negative[field], t.positive);
  std::array<std::uint64_t, 8> vertex;
  std::array<std::uint64_t, 4> crossing;  // where both fields are zero
  int vertices = 0, crossings = 0;
  for (int k = 0; k < loop.size; ++k) {
    const Edge &here = loop.edge[k], &next = loop.edge[(k + 1) % loop.size];
    const bool kept = s.other_negative(field, here);
    if (kept)
      vertex[vertices++] = names.of_edge(cell, t.corner[here.from], t.corner[here.to], field);
    if (kept == s.other_negative(field, next)) continue;
    // Both edges lie in the face of three corners.
    std::array<int, 4> corners = {here.from, here.to, next.from, next.to};
    std::sort(corners.begin(), corners.end());
    std::unique(corners.begin(), corners.end());
    vertex[vertices] = crossing[crossings++] =
        names.of_face(cell, t.corner[corners[0]], t.corner[corners[1]], t.corner[corners[2]]);
    ++vertices;
  }
  for (int k = 1; k + 1 < vertices; ++k)
    piece.triangles.push_back({vertex[0], vertex[k], vertex[k + 1]});
  if (field == 0 && crossings == 2) piece.margin.push_back({crossing[0], crossing[1]});
}

Piece piece_of(const Fields& fields, const Names& names, const Index3& first) {
  constexpr int kSide = kBrickEdge + 1;
  const auto offset = [](int x, int y, int z) { return (x * kSide + y) * kSide + z; };
  std::array<std::array<float, 2>, kSide * kSide * kSide> samples;
  for (int x = 0; x < kSide; ++x)
    for (int y = 0; y < kSide; ++y)
      for (int z = 0; z < kSide; ++z) samples[offset(x, y, z)] = fields.at(first + Index3(x, y, z));
  Piece piece;
  for (int v = 0; v < kBrickVoxels; ++v) {
    const Index3 at(v >> 6, v >> 3 & 7, v & 7);
    std::array<int, 2> negatives{};
    std::array<std::array<float, 2>, 8> corner;
    for (int c = 0; c < 8; ++c) {
      const Index3 i = at + corner_offset(c);
      corner[c] = samples[offset(i.x(), i.y(), i.z())];
      for (int field = 0; field < 2; ++field) negatives[field] += corner[c][field] < 0;
    }
    if (negatives[0] == 0 || negatives[1] == 0 || negatives[0] + negatives[1] == 16) continue;
    for (const Tetrahedron& t : kTetrahedra) {
      Corners s;
      for (int field = 0; field < 2; ++field)
        for (int c = 0; c < 4; ++c) {
          s.value[field][c] = corner[t.corner[c]][field];
          s.negative[field][c] = s.value[field][c] < 0;
        }
      for (int field = 0; field < 2; ++field) add_polygon(first + at, t, s, field, names, piece);
    }
  }
  return piece;
}

// Place and tissue of a vertex by its name.
struct Vertex {
  Vec3 at;  // in voxels
  std::uint8_t tissue;
};

Vertex vertex_of(const LayeredTooth& tooth, const Fields& fields, const Names& names,
                 std::uint64_t name) {
  const Index3 a = names.voxel(name);
  const auto code = static_cast<int>(name % kCodes);
  if (code < kFaceCodes) {
    const int field = code / 7;
    const Index3 b = a + corner_offset(code % 7 + 1);
    const double u = fields.at(a)[field], v = fields.at(b)[field], t = u / (u - v);
    return {a.cast<double>() + t * (b - a).cast<double>(),
            u < 0 ? tissue_under(tooth, a, b, t) : tissue_under(tooth, b, a, 1 - t)};
  }
  const Index3 b = a + corner_offset((code - kFaceCodes) / 7 + 1),
               c = b + corner_offset((code - kFaceCodes) % 7 + 1);
  const std::array<Index3, 3> corner = {a, b, c};
  Vec3 f, g;
  for (int k = 0; k < 3; ++k) {
    f[k] = fields.at(corner[k])[0];
    g[k] = fields.at(corner[k])[1];
  }
  // Weights of the corners at which both are zero; where rounding or a tie leaves none, the middle.
  Vec3 weight = f.cross(g);
  if (weight.sum() < 0) weight = -weight;
  weight = weight.cwiseMax(0.0);
  weight = weight.sum() > 0 ? Vec3(weight / weight.sum()) : Vec3::Constant(1.0 / 3);
  int inside = 0, outside = 0;
  const Vec3 remaining = f.cwiseMax(g);
  remaining.minCoeff(&inside);
  remaining.maxCoeff(&outside);
  return {
      weight[0] * a.cast<double>() + weight[1] * b.cast<double>() + weight[2] * c.cast<double>(),
      tissue_under(tooth, corner[inside], corner[outside], 0)};
}

}  // namespace

SharpSurface extract_sharp_surface(const LayeredTooth& tooth) {
  if (!tooth.parts) throw Error("the tooth's cut isn't known, so its margin isn't either");
  const Fields fields(tooth);
  const Names names(fields);
  const Index3 counts = fields.brick_counts();
  std::vector<Piece> pieces(counts.cast<std::size_t>().prod());
  tbb::parallel_for(std::size_t{0}, pieces.size(), [&](std::size_t b) {
    const auto z = static_cast<int>(b % counts.z());
    const auto y = static_cast<int>(b / counts.z() % counts.y());
    const auto x = static_cast<int>(b / counts.z() / counts.y());
    const Index3 first = fields.first_voxel() + kBrickEdge * Index3(x, y, z);
    if (fields.may_pass(first)) pieces[b] = piece_of(fields, names, first);
  });

  std::vector<std::array<std::uint64_t, 3>> triangles;
  std::vector<std::array<std::uint64_t, 2>> margin;
  for (const Piece& piece : pieces) {
    triangles.insert(triangles.end(), piece.triangles.begin(), piece.triangles.end());
    margin.insert(margin.end(), piece.margin.begin(), piece.margin.end());
  }
  if (triangles.size() > std::numeric_limits<std::int32_t>::max() / 3)
    throw Error("the surface has " + std::to_string(triangles.size()) +
                " triangles, more than a mesh file can number; use a larger voxel size");
  std::vector<std::uint64_t> used;
  used.reserve(3 * triangles.size());
  for (const auto& t : triangles) used.insert(used.end(), t.begin(), t.end());
  tbb::parallel_sort(used.begin(), used.end());
  used.erase(std::unique(used.begin(), used.end()), used.end());
  const auto number = [&](std::uint64_t name) {
    return static_cast<std::uint32_t>(std::lower_bound(used.begin(), used.end(), name) -
                                      used.begin());
  };

  SharpSurface surface;
  TriangleMesh& mesh = surface.mesh;
  mesh.vertices.resize(used.size());
  mesh.tissue.resize(used.size());
  mesh.triangles.resize(triangles.size());
  tbb::parallel_for(std::size_t{0}, used.size(), [&](std::size_t v) {
    const Vertex vertex = vertex_of(tooth, fields, names, used[v]);
    mesh.vertices[v] = (tooth.lattice.origin + tooth.lattice.voxel * vertex.at).cast<float>();
    mesh.tissue[v] = vertex.tissue;
  });
  tbb::parallel_for(std::size_t{0}, triangles.size(), [&](std::size_t t) {
    for (int k = 0; k < 3; ++k) mesh.triangles[t][k] = number(triangles[t][k]);
  });
  for (const auto& edge : margin) surface.margin.push_back({number(edge[0]), number(edge[1])});
  return surface;
}

}  // namespace toothprep
