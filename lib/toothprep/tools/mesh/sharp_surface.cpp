#include "toothprep/tools/mesh/sharp_surface.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/tooth/cell_cases.h"
#include "toothprep/step/tooth/tissue_under.h"
#include "toothprep/tools/mesh/crease_division.h"
#include "toothprep/tools/mesh/pyramid_loops.h"
#include "toothprep/tools/mesh/two_fields.h"

namespace toothprep {
namespace {

// Codes of vertices: of edges from 0 (direction - 1, and 7 more for g), of faces, of the ways from
// a cell's corners to its middle (the corner, and 8 more for g).
constexpr int kFaceCodes = 14, kMiddleCodes = kFaceCodes + 49;
constexpr std::uint64_t kCodes = 128;

// The six tetrahedra of a cell run along its edges from corner 0 to corner 7, an axis after
// another. Corners are bit masks as in step/tooth/cell_cases.h; each holds the one before.
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

// Vertices are named by a voxel, counted from the box's lower corner, and a code: of the edge from
// there that crosses a field, of the face from there on which both are zero, or of the way to the
// middle of the cell there that crosses a field.
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
  std::uint64_t of_middle(const Index3& cell, int corner, int field) const {
    return name(cell, kMiddleCodes + 8 * field + corner);
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
  std::vector<bool> on_cut;  // per triangle: of g
  std::vector<std::array<std::uint64_t, 2>> margin;
  std::vector<std::uint64_t> names;    // of the triangles' vertices, ascending
  std::vector<std::uint32_t> numbers;  // of these in the mesh
  std::size_t first_triangle = 0;      // in the mesh

  void add(const std::array<std::uint64_t, 3>& triangle, int field) {
    triangles.push_back(triangle);
    on_cut.push_back(field == 1);
  }
  void collect_names() {
    names.reserve(3 * triangles.size());
    for (const auto& t : triangles) names.insert(names.end(), t.begin(), t.end());
    std::sort(names.begin(), names.end());
    names.erase(std::unique(names.begin(), names.end()), names.end());
  }
  std::uint32_t number(std::uint64_t name) const {
    return numbers[static_cast<std::size_t>(std::lower_bound(names.begin(), names.end(), name) -
                                            names.begin())];
  }
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
struct TetrahedronCorners {
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
void add_polygon(const Index3& cell, const Tetrahedron& t, const TetrahedronCorners& s, int field,
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
  for (int k = 1; k + 1 < vertices; ++k) piece.add({vertex[0], vertex[k], vertex[k + 1]}, field);
  if (field == 0 && crossings == 2) piece.margin.push_back({crossing[0], crossing[1]});
}

// ---- Cells

void add_tetrahedra(const Index3& cell, const CellValues& corner, const Names& names,
                    Piece& piece) {
  for (const Tetrahedron& t : kTetrahedra) {
    TetrahedronCorners s;
    for (int field = 0; field < 2; ++field)
      for (int c = 0; c < 4; ++c) {
        s.value[field][c] = corner[t.corner[c]][field];
        s.negative[field][c] = s.value[field][c] < 0;
      }
    for (int field = 0; field < 2; ++field) add_polygon(cell, t, s, field, names, piece);
  }
}

// As extract_surface() does it.
void add_cube(const Index3& cell, const CellValues& corner, int field, const Names& names,
              Piece& piece) {
  const CellCases& cases = cell_cases();
  const CellCase& its = cases.cases[negative_corners(corner, field)];
  std::array<float, 8> values;
  for (int c = 0; c < 8; ++c) values[c] = corner[c][field];
  for (int l = 0; l < its.loops; ++l) {
    const CellLoop& loop = its.loop[l];
    std::array<std::uint64_t, 7> vertex;
    for (int i = 0; i < loop.size; ++i) {
      const CellEdge& edge = cases.edges[loop.edge[i]];
      vertex[i] = names.of_edge(cell, edge.base, edge.base | 1 << edge.axis, field);
    }
    const int apex = fan_apex(loop, values);
    for (int d = 1; d < loop.size - 1; ++d)
      piece.add({vertex[apex], vertex[(apex + d) % loop.size], vertex[(apex + d + 1) % loop.size]},
                field);
  }
}

// One field's surface in a cell whose faces `divided` (bits: 2 axis + side) are those of
// tetrahedra: by a pyramid over each face, over those by two.
void add_pyramids(const Index3& cell, const CellValues& corner, int field, unsigned divided,
                  const Fields& fields, const Names& names, Piece& piece) {
  const unsigned negative = negative_corners(corner, field) |
                            static_cast<unsigned>(fields.middle(cell, field) < 0) << kCellMiddle;
  const auto add = [&](const std::array<int, 4>& base, int corners) {
    const PyramidLoops loops = pyramid_loops(base, corners, negative);
    for (int l = 0; l < loops.count; ++l) {
      const PyramidLoop& loop = loops.loop[l];
      const auto vertex = [&](int i) {
        const auto& [a, b] = loop.edge[i % loop.size];
        return b == kCellMiddle ? names.of_middle(cell, a, field)
                                : names.of_edge(cell, a, b, field);
      };
      for (int d = 1; d < loop.size - 1; ++d)
        piece.add({vertex(loop.apex), vertex(loop.apex + d), vertex(loop.apex + d + 1)}, field);
    }
  };
  for (int axis = 0; axis < 3; ++axis)
    for (int side = 0; side < 2; ++side) {
      const std::array<int, 4> c = corners_of_face(axis, side);
      if ((divided >> (2 * axis + side) & 1) == 0) {
        add(c, 4);
        continue;
      }
      add({c[0], c[1], c[2]}, 3);
      add({c[0], c[2], c[3]}, 3);
    }
}

Piece piece_of(const BrickSamples& samples, const Fields& fields, const Names& names,
               const Index3& first) {
  Piece piece;
  for (int v = 0; v < kBrickVoxels; ++v) {
    const CellKind kind = samples.kind(v);
    if (kind == CellKind::kEmpty) continue;
    const Index3 at(v >> 6, v >> 3 & 7, v & 7);
    const CellValues corner = samples.cell(at);
    if (kind == CellKind::kMargin) {
      add_tetrahedra(first + at, corner, names, piece);
      continue;
    }
    const int field = kind == CellKind::kIntact ? 0 : 1;
    const unsigned divided = samples.divided_faces(at);
    if (divided != 0)
      add_pyramids(first + at, corner, field, divided, fields, names, piece);
    else
      add_cube(first + at, corner, field, names, piece);
  }
  return piece;
}

// Place and tissue of a vertex by its name.
struct Vertex {
  Vec3 at;  // in voxels
  std::uint8_t tissue;
};

// Between a cell's corner and its middle.
Vertex vertex_to_middle(const LayeredTooth& tooth, const Fields& fields, const Index3& cell,
                        int corner, int field) {
  const Index3 a = cell + corner_offset(corner);
  const double u = fields.at(a)[field], v = fields.middle(cell, field), t = u / (u - v);
  const Vec3 middle = cell.cast<double>() + Vec3::Constant(0.5);
  Vertex vertex{a.cast<double>() + t * (middle - a.cast<double>()), 0};
  if (u < 0) {
    vertex.tissue = tissue_under(tooth, a, cell + corner_offset(7 - corner), t / 2);
    return vertex;
  }
  Index3 deepest = a;
  for (int c = 0; c < 8; ++c)
    if (const Index3 i = cell + corner_offset(c); fields.at(i)[field] < fields.at(deepest)[field])
      deepest = i;
  vertex.tissue = tissue_under(tooth, deepest, a, 0.5);
  return vertex;
}

Vertex vertex_of(const LayeredTooth& tooth, const Fields& fields, const Names& names,
                 std::uint64_t name) {
  const Index3 a = names.voxel(name);
  const auto code = static_cast<int>(name % kCodes);
  if (code >= kMiddleCodes)
    return vertex_to_middle(tooth, fields, a, (code - kMiddleCodes) % 8, (code - kMiddleCodes) / 8);
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

// The ends of the way on which a vertex of one field was found, in voxels.
std::array<Vec3, 2> way_of(const Names& names, std::uint64_t name) {
  const Index3 a = names.voxel(name);
  const auto code = static_cast<int>(name % kCodes);
  if (code < kFaceCodes)
    return {a.cast<double>(), (a + corner_offset(code % 7 + 1)).cast<double>()};
  return {(a + corner_offset((code - kMiddleCodes) % 8)).cast<double>(),
          a.cast<double>() + Vec3::Constant(0.5)};
}

}  // namespace

SharpSurface extract_sharp_surface(const LayeredTooth& tooth) {
  if (!tooth.parts) throw Error("the tooth's cut isn't known, so its margin isn't either");
  const Fields fields(tooth);
  const Names names(fields);
  std::vector<Piece> pieces(fields.bricks());
  tbb::parallel_for(std::size_t{0}, pieces.size(), [&](std::size_t b) {
    const Index3 first = fields.brick_origin(b);
    if (!fields.may_pass(first)) return;
    pieces[b] = piece_of(BrickSamples(fields, first), fields, names, first);
    pieces[b].collect_names();
  });

  std::size_t triangles = 0;
  std::vector<bool> on_cut;
  std::vector<std::uint64_t> used;
  for (Piece& piece : pieces) {
    piece.first_triangle = triangles;
    triangles += piece.triangles.size();
    on_cut.insert(on_cut.end(), piece.on_cut.begin(), piece.on_cut.end());
    used.insert(used.end(), piece.names.begin(), piece.names.end());
  }
  if (triangles > std::numeric_limits<std::int32_t>::max() / 3)
    throw Error("the surface has " + std::to_string(triangles) +
                " triangles, more than a mesh file can number; use a larger voxel size");
  if (triangles == 0) return {};
  tbb::parallel_sort(used.begin(), used.end());
  used.erase(std::unique(used.begin(), used.end()), used.end());

  SharpSurface surface;
  TriangleMesh& mesh = surface.mesh;
  mesh.vertices.resize(used.size());
  mesh.tissue.resize(used.size());
  mesh.triangles.resize(triangles);
  tbb::parallel_for(std::size_t{0}, used.size(), [&](std::size_t v) {
    const Vertex vertex = vertex_of(tooth, fields, names, used[v]);
    mesh.vertices[v] = (tooth.lattice.origin + tooth.lattice.voxel * vertex.at).cast<float>();
    mesh.tissue[v] = vertex.tissue;
  });
  tbb::parallel_for(std::size_t{0}, pieces.size(), [&](std::size_t b) {
    Piece& piece = pieces[b];
    auto at = used.begin();
    for (const std::uint64_t name : piece.names) {
      at = std::lower_bound(at, used.end(), name);
      piece.numbers.push_back(static_cast<std::uint32_t>(at - used.begin()));
    }
    for (std::size_t t = 0; t < piece.triangles.size(); ++t)
      for (int k = 0; k < 3; ++k)
        mesh.triangles[piece.first_triangle + t][k] = piece.number(piece.triangles[t][k]);
  });
  for (const Piece& piece : pieces)
    for (const auto& edge : piece.margin)
      surface.margin.push_back({piece.number(edge[0]), piece.number(edge[1])});
  pieces = {};
  divide_at_creases(surface, tooth, fields, std::move(on_cut),
                    [&](std::uint32_t v) { return way_of(names, used[v]); });
  return surface;
}

TriangleMesh sharpest_surface(const LayeredTooth& tooth) {
  return tooth.parts ? extract_sharp_surface(tooth).mesh : extract_surface(tooth, SurfaceOf::kAll);
}

}  // namespace toothprep
