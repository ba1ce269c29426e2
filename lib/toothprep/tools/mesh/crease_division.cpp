#include "toothprep/tools/mesh/crease_division.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <optional>
#include <tuple>
#include <utility>

#include "toothprep/step/tooth/cell_cases.h"
#include "toothprep/step/tooth/tissue_under.h"
#include "toothprep/tools/mesh/crease_vertices.h"
#include "toothprep/tools/mesh/creases.h"

namespace toothprep {
namespace {

constexpr double kLooksAway = 0.1;      // cosine between a triangle and the tooth's surface
constexpr double kShortestPart = 0.02;  // of an edge that is divided, to its ends
constexpr double kBend = 0.94;          // cosine between triangles beside a crease, 20 degrees

using MeshEdge = std::array<std::uint32_t, 2>;
using MeshTriangle = std::array<std::uint32_t, 3>;

MeshEdge with_ascending_ends(std::uint32_t a, std::uint32_t b) {
  return {std::min(a, b), std::max(a, b)};
}

// What is known of a cell with faces of the cut.
struct CreaseCell {
  int voxel;  // in its brick
  Index3 cell;
  CreaseFinder finder;
  std::optional<CreaseFace> tooth;  // where the margin is in the cell
};

// By what they belong to, then by cell, each once.
template <class Key>
void sort_by_cell(std::vector<std::pair<Key, const CreaseCell*>>& cells_of) {
  const auto rank = [](const auto& x) {
    const Index3& cell = x.second->cell;
    return std::tuple(x.first, cell.x(), cell.y(), cell.z());
  };
  std::sort(cells_of.begin(), cells_of.end(),
            [&](const auto& a, const auto& b) { return rank(a) < rank(b); });
  cells_of.erase(std::unique(cells_of.begin(), cells_of.end()), cells_of.end());
}

class CreaseDivision {
 public:
  CreaseDivision(SharpSurface& surface, const LayeredTooth& tooth, const Fields& fields,
                 std::vector<bool> on_cut)
      : surface_(surface),
        mesh_(surface.mesh),
        tooth_(tooth),
        fields_(fields),
        on_cut_(std::move(on_cut)),
        vertices_(mesh_, tooth.lattice.voxel) {}

  void run(const std::function<std::array<Vec3, 2>(std::uint32_t)>& way) {
    find_cells();
    place_vertices(way);
    divide_edges();
    divide_triangles();
    vertices_.place([this](std::size_t t, const Vec3& normal) { return looks_well(t, normal); },
                    [this](std::size_t s, std::size_t t, const MeshEdge& edge) {
                      return on_cut_[s] == on_cut_[t] &&
                             !(on_cut_[s] && on_crease_[edge[0]] && on_crease_[edge[1]]);
                    });
    find_creases();
  }

 private:
  struct Divided {
    MeshEdge edge;
    std::uint32_t vertex;
    bool is_corner;
  };

  void find_cells();
  const CreaseCell* cell_at(const Vec3& x) const;
  void place_vertices(const std::function<std::array<Vec3, 2>(std::uint32_t)>& way);
  std::optional<Vec3> on_way(const std::vector<const CreaseCell*>& cells,
                             const std::array<Vec3, 2>& way) const;
  std::optional<Vec3> under_tooth(const std::vector<const CreaseCell*>& cells,
                                  const std::optional<Vec3>& at) const;
  void divide_edges();
  void divide_edge(const MeshEdge& edge, const std::vector<const CreaseCell*>& cells);
  void divide_triangles();
  void divide_in_four(const MeshTriangle& t, const std::array<const Divided*, 3>& edges,
                      const CreaseCell* cell, std::vector<MeshTriangle>& pieces);
  const Divided* divided(std::uint32_t a, std::uint32_t b) const;
  bool looks_well(std::size_t triangle, const Vec3& normal) const;
  void find_creases();
  std::uint32_t new_vertex(const CreaseCell& cell, const Vec3& at);
  bool is_margin(const MeshEdge& edge) const {
    return std::binary_search(margin_.begin(), margin_.end(), edge);
  }
  Vec3 in_voxels(std::uint32_t v) const { return tooth_.lattice.to_index(placed_[v]); }
  Vec3 in_mm(const CreaseCell& cell, const Vec3& at) const {
    return tooth_.lattice.origin + tooth_.lattice.voxel * (cell.cell.cast<double>() + at);
  }

  SharpSurface& surface_;
  TriangleMesh& mesh_;
  const LayeredTooth& tooth_;
  const Fields& fields_;
  std::vector<bool> on_cut_;  // per triangle
  CreaseVertices vertices_;
  std::vector<std::vector<CreaseCell>> cells_;  // per brick
  std::vector<const CreaseCell*> cell_of_;      // per triangle, or null
  std::vector<MeshEdge> margin_;                // ascending
  std::vector<Vec3> placed_;                    // per vertex, mm
  std::vector<bool> on_crease_;                 // per vertex
  std::vector<Divided> divided_;                // by edges
};

void CreaseDivision::find_cells() {
  cells_.resize(fields_.bricks());
  tbb::parallel_for(std::size_t{0}, cells_.size(), [&](std::size_t brick) {
    const Index3 first = fields_.brick_origin(brick);
    if (!fields_.may_pass(first)) return;
    const BrickSamples samples(fields_, first);
    for (int v = 0; v < kBrickVoxels; ++v) {
      const CellKind kind = samples.kind(v);
      if (kind != CellKind::kCut && kind != CellKind::kMargin) continue;
      const Index3 cell = first + Index3(v >> 6, v >> 3 & 7, v & 7);
      CreaseFinder finder(tooth_.parts->cut, tooth_.lattice.voxel, cell);
      if (!finder.has_faces()) continue;
      std::optional<CreaseFace> face;
      if (kind == CellKind::kMargin)
        face = face_near(tooth_.parts->intact, tooth_.lattice.voxel, cell, Vec3::Constant(0.5));
      cells_[brick].push_back({v, cell, std::move(finder), face});
    }
  });
  cell_of_.resize(mesh_.triangles.size());
  tbb::parallel_for(std::size_t{0}, mesh_.triangles.size(), [&](std::size_t t) {
    Vec3 middle = Vec3::Zero();
    for (const std::uint32_t v : mesh_.triangles[t]) middle += mesh_.vertices[v].cast<double>() / 3;
    cell_of_[t] = cell_at(tooth_.lattice.to_index(middle));
  });
}

const CreaseCell* CreaseDivision::cell_at(const Vec3& x) const {
  const Index3 cell = x.array().floor().cast<int>();
  const std::optional<std::size_t> brick = fields_.brick_of(cell);
  if (!brick) return nullptr;
  const Index3 in = cell - fields_.brick_origin(*brick);
  const int voxel = in.x() << 6 | in.y() << 3 | in.z();
  const auto& its = cells_[*brick];
  const auto found = std::lower_bound(its.begin(), its.end(), voxel,
                                      [](const CreaseCell& c, int v) { return c.voxel < v; });
  return found != its.end() && found->voxel == voxel ? &*found : nullptr;
}

// Of the cut, on the faces that the cells about them have.
void CreaseDivision::place_vertices(const std::function<std::array<Vec3, 2>(std::uint32_t)>& way) {
  placed_.reserve(mesh_.vertices.size());
  for (const auto& v : mesh_.vertices) placed_.push_back(v.cast<double>());
  for (const MeshEdge& e : surface_.margin) margin_.push_back(with_ascending_ends(e[0], e[1]));
  std::sort(margin_.begin(), margin_.end());
  std::vector<bool> on_margin(mesh_.vertices.size());
  for (const MeshEdge& e : margin_) on_margin[e[0]] = on_margin[e[1]] = true;
  std::vector<bool> on_cut(mesh_.vertices.size());
  for (std::size_t t = 0; t < mesh_.triangles.size(); ++t)
    if (on_cut_[t])
      for (const std::uint32_t v : mesh_.triangles[t]) on_cut[v] = true;
  std::vector<std::pair<std::uint32_t, const CreaseCell*>> cells_of;
  for (std::size_t t = 0; t < mesh_.triangles.size(); ++t)
    if (cell_of_[t] != nullptr)
      for (const std::uint32_t v : mesh_.triangles[t])
        if (on_cut_[t] || !on_margin[v]) cells_of.push_back({v, cell_of_[t]});
  sort_by_cell(cells_of);
  for (std::size_t k = 0; k < cells_of.size();) {
    const std::uint32_t v = cells_of[k].first;
    std::vector<const CreaseCell*> cells;
    for (; k < cells_of.size() && cells_of[k].first == v; ++k) cells.push_back(cells_of[k].second);
    std::optional<Vec3> to;
    if (on_cut[v] && !on_margin[v]) {
      to = under_tooth(cells, on_way(cells, way(v)));
    } else {
      for (const CreaseCell* c : cells) {
        if (!c->tooth) continue;
        const Vec3 x = in_voxels(v) - c->cell.cast<double>();
        const std::optional<Vec3> at =
            on_margin[v] ? c->finder.on_margin(x, *c->tooth) : c->finder.out_of_cut(x, *c->tooth);
        if (at) to = in_mm(*c, *at);
        if (at) break;
      }
    }
    if (!to) continue;
    placed_[v] = *to;
    vertices_.add(v, *to);
  }
}

std::optional<Vec3> CreaseDivision::on_way(const std::vector<const CreaseCell*>& cells,
                                           const std::array<Vec3, 2>& way) const {
  double sum = 0;
  int count = 0;
  for (const CreaseCell* c : cells) {
    const Vec3 origin = c->cell.cast<double>();
    if (const std::optional<double> t = c->finder.crossing(way[0] - origin, way[1] - origin)) {
      sum += *t;
      ++count;
    }
  }
  if (count == 0) return std::nullopt;
  const double part = std::clamp(sum / count, kEdgeMargin, 1 - kEdgeMargin);
  return tooth_.lattice.origin + tooth_.lattice.voxel * (way[0] + part * (way[1] - way[0]));
}

// Where such a vertex may be, that the tooth's surface does not pass.
std::optional<Vec3> CreaseDivision::under_tooth(const std::vector<const CreaseCell*>& cells,
                                                const std::optional<Vec3>& at) const {
  if (!at) return at;
  for (const CreaseCell* c : cells) {
    const Vec3 x = tooth_.lattice.to_index(*at) - c->cell.cast<double>();
    if (!c->tooth || -c->tooth->level(x) >= kClear) continue;
    const std::optional<Vec3> under =
        c->finder.on_margin(x, c->tooth->shifted(-cleared(-c->tooth->level(x))));
    if (under) return in_mm(*c, *under);
  }
  return at;
}

void CreaseDivision::divide_edges() {
  on_crease_.resize(mesh_.vertices.size());
  std::vector<std::pair<MeshEdge, const CreaseCell*>> cells_of;
  for (std::size_t t = 0; t < mesh_.triangles.size(); ++t)
    if (on_cut_[t] && cell_of_[t] != nullptr)
      for (int k = 0; k < 3; ++k)
        cells_of.push_back(
            {with_ascending_ends(mesh_.triangles[t][k], mesh_.triangles[t][(k + 1) % 3]),
             cell_of_[t]});
  sort_by_cell(cells_of);
  for (std::size_t k = 0; k < cells_of.size();) {
    const MeshEdge edge = cells_of[k].first;
    std::vector<const CreaseCell*> cells;
    for (; k < cells_of.size() && cells_of[k].first == edge; ++k)
      cells.push_back(cells_of[k].second);
    divide_edge(edge, cells);
  }
}

void CreaseDivision::divide_edge(const MeshEdge& edge,
                                 const std::vector<const CreaseCell*>& cells) {
  const bool margin = is_margin(edge);
  std::optional<EdgeAtCrease> best;
  const CreaseCell* its = nullptr;
  for (const CreaseCell* c : cells) {
    if (margin && !c->tooth) continue;
    const Vec3 origin = c->cell.cast<double>();
    const Vec3 u = in_voxels(edge[0]) - origin, v = in_voxels(edge[1]) - origin;
    std::optional<EdgeAtCrease> found = c->finder.edge(u, v, margin ? &*c->tooth : nullptr);
    if (!margin && found && found->crossed && c->tooth && -c->tooth->level(found->at) < kClear) {
      const CreaseFace under = c->tooth->shifted(-cleared(-c->tooth->level(found->at)));
      found = c->finder.edge(u, v, &under);
    }
    if (!found || (best && found->misfit > best->misfit - 0.03)) continue;
    best = found;
    its = c;
  }
  if (!best) return;
  for (int end = 0; end < 2; ++end)
    if (best->on_crease[end]) on_crease_[edge[end]] = true;
  if (!best->crossed) return;
  const double part = std::clamp(best->part, kShortestPart, 1 - kShortestPart);
  const std::uint32_t vertex = new_vertex(*its, in_mm(*its, best->at));
  vertices_.add_dividing(vertex, {edge[0], edge[1]}, {1 - part, part}, placed_[vertex]);
  divided_.push_back({edge, vertex, best->is_corner});
}

// The tissue is that under the cell's deepest corner.
std::uint32_t CreaseDivision::new_vertex(const CreaseCell& cell, const Vec3& at) {
  const auto vertex = static_cast<std::uint32_t>(mesh_.vertices.size());
  int deepest = 0;
  const auto depth = [&](int corner) {
    const auto both = fields_.at(cell.cell + corner_offset(corner));
    return std::max(both[0], both[1]);
  };
  for (int c = 1; c < 8; ++c)
    if (depth(c) < depth(deepest)) deepest = c;
  mesh_.vertices.push_back(at.cast<float>());
  mesh_.tissue.push_back(tissue_under(tooth_, cell.cell + corner_offset(deepest),
                                      cell.cell + corner_offset(7 - deepest), 0.5));
  placed_.push_back(at);
  on_crease_.push_back(true);
  return vertex;
}

const CreaseDivision::Divided* CreaseDivision::divided(std::uint32_t a, std::uint32_t b) const {
  const MeshEdge edge = with_ascending_ends(a, b);
  const auto found =
      std::lower_bound(divided_.begin(), divided_.end(), edge,
                       [](const Divided& d, const MeshEdge& e) { return d.edge < e; });
  return found != divided_.end() && found->edge == edge ? &*found : nullptr;
}

void CreaseDivision::divide_triangles() {
  std::vector<bool> at_divided(mesh_.vertices.size());
  for (const Divided& d : divided_) at_divided[d.edge[0]] = at_divided[d.edge[1]] = true;
  std::vector<MeshTriangle> triangles;
  std::vector<bool> on_cut;
  std::vector<const CreaseCell*> cells;
  std::vector<MeshTriangle> pieces;
  for (std::size_t n = 0; n < mesh_.triangles.size(); ++n) {
    MeshTriangle t = mesh_.triangles[n];
    pieces.clear();
    std::array<const Divided*, 3> edges{};  // from a corner to the next
    int count = 0;
    for (int k = 0; k < 3; ++k)
      if (at_divided[t[k]] && at_divided[t[(k + 1) % 3]]) {
        edges[k] = divided(t[k], t[(k + 1) % 3]);
        count += edges[k] != nullptr;
      }
    // With the first divided edge in front; of two, with the undivided one last.
    const auto in_front = [&] {
      return edges[0] != nullptr && (count != 2 || edges[1] != nullptr);
    };
    while ((count == 1 || count == 2) && !in_front()) {
      std::rotate(t.begin(), t.begin() + 1, t.end());
      std::rotate(edges.begin(), edges.begin() + 1, edges.end());
    }
    if (count == 0) {
      pieces.push_back(t);
    } else if (count == 1) {
      pieces.push_back({t[0], edges[0]->vertex, t[2]});
      pieces.push_back({edges[0]->vertex, t[1], t[2]});
    } else if (count == 2) {
      const std::uint32_t p = edges[0]->vertex, q = edges[1]->vertex;
      pieces.push_back({p, t[1], q});
      if ((placed_[t[0]] - placed_[q]).squaredNorm() < (placed_[p] - placed_[t[2]]).squaredNorm()) {
        pieces.push_back({t[0], p, q});
        pieces.push_back({t[0], q, t[2]});
      } else {
        pieces.push_back({t[0], p, t[2]});
        pieces.push_back({p, q, t[2]});
      }
    } else {
      divide_in_four(t, edges, on_cut_[n] ? cell_of_[n] : nullptr, pieces);
    }
    triangles.insert(triangles.end(), pieces.begin(), pieces.end());
    on_cut.insert(on_cut.end(), pieces.size(), on_cut_[n]);
    cells.insert(cells.end(), pieces.size(), cell_of_[n]);
  }
  mesh_.triangles = std::move(triangles);
  on_cut_ = std::move(on_cut);
  cell_of_ = std::move(cells);
  std::vector<MeshEdge> margin;
  for (const MeshEdge& e : surface_.margin) {
    const Divided* its = divided(e[0], e[1]);
    if (its == nullptr) {
      margin.push_back(e);
      continue;
    }
    margin.push_back({e[0], its->vertex});
    margin.push_back({its->vertex, e[1]});
  }
  surface_.margin = std::move(margin);
}

// A triangle of three divided edges: about the corner of the faces, if it's in the triangle, else
// about the edge that goes through it.
void CreaseDivision::divide_in_four(const MeshTriangle& t,
                                    const std::array<const Divided*, 3>& edges,
                                    const CreaseCell* cell, std::vector<MeshTriangle>& pieces) {
  const std::array<std::uint32_t, 3> on = {edges[0]->vertex, edges[1]->vertex, edges[2]->vertex};
  for (int k = 0; k < 3; ++k) pieces.push_back({t[k], on[k], on[(k + 2) % 3]});
  std::optional<Vec3> corner;
  const bool is_met =
      std::any_of(edges.begin(), edges.end(), [](const Divided* d) { return d->is_corner; });
  if (cell != nullptr && !is_met) {
    const Vec3 middle = (in_voxels(t[0]) + in_voxels(t[1]) + in_voxels(t[2])) / 3;
    corner = cell->finder.corner(middle - cell->cell.cast<double>());
  }
  if (!corner) {
    pieces.push_back({on[0], on[1], on[2]});
    return;
  }
  const std::uint32_t vertex = new_vertex(*cell, in_mm(*cell, *corner));
  vertices_.add_dividing(vertex, {on[0], on[1], on[2]}, {1.0 / 3, 1.0 / 3, 1.0 / 3},
                         placed_[vertex]);
  for (int k = 0; k < 3; ++k) pieces.push_back({on[k], on[(k + 1) % 3], vertex});
}

// Of a triangle's normal: whether a face of the cut, or the field's gradient, is about the same.
bool CreaseDivision::looks_well(std::size_t triangle, const Vec3& normal) const {
  const CreaseCell* its = cell_of_[triangle];
  if (on_cut_[triangle] && its != nullptr) return its->finder.faces_towards(-normal);
  Vec3 middle = Vec3::Zero();
  for (const std::uint32_t v : mesh_.triangles[triangle])
    middle += tooth_.lattice.to_index(mesh_.vertices[v].cast<double>()) / 3;
  const Index3 cell = middle.array().floor().cast<int>();
  const Vec3 in = middle - cell.cast<double>();
  Vec3 gradient = Vec3::Zero();
  for (int c = 0; c < 8; ++c) {
    const Index3 corner = corner_offset(c);
    const double value = fields_.at(cell + corner)[on_cut_[triangle] ? 1 : 0];
    for (int axis = 0; axis < 3; ++axis) {
      double weight = corner[axis] == 1 ? 1 : -1;
      for (const int other : {(axis + 1) % 3, (axis + 2) % 3})
        weight *= corner[other] == 1 ? in[other] : 1 - in[other];
      gradient[axis] += weight * value;
    }
  }
  return normal.dot(gradient.normalized()) > kLooksAway;
}

// Edges of the cut between vertices on creases where its triangles bend.
void CreaseDivision::find_creases() {
  std::vector<std::pair<MeshEdge, Vec3>> beside;
  for (std::size_t t = 0; t < mesh_.triangles.size(); ++t) {
    if (!on_cut_[t]) continue;
    const MeshTriangle& c = mesh_.triangles[t];
    const auto at = [&](int k) -> Vec3 { return mesh_.vertices[c[k]].cast<double>(); };
    for (int k = 0; k < 3; ++k)
      if (on_crease_[c[k]] && on_crease_[c[(k + 1) % 3]])
        beside.push_back({with_ascending_ends(c[k], c[(k + 1) % 3]),
                          (at(1) - at(0)).cross(at(2) - at(0)).normalized()});
  }
  std::stable_sort(beside.begin(), beside.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  for (std::size_t k = 0; k + 1 < beside.size(); ++k)
    if (beside[k].first == beside[k + 1].first &&
        beside[k].second.dot(beside[k + 1].second) < kBend)
      surface_.creases.push_back(beside[k].first);
}

}  // namespace

void divide_at_creases(SharpSurface& surface, const LayeredTooth& tooth, const Fields& fields,
                       std::vector<bool> on_cut,
                       const std::function<std::array<Vec3, 2>(std::uint32_t)>& way) {
  CreaseDivision(surface, tooth, fields, std::move(on_cut)).run(way);
}

}  // namespace toothprep
