#include "toothprep/tools/mesh/tissue_division.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <map>
#include <unordered_map>

#include "toothprep/step/tooth/cell_cases.h"
#include "toothprep/tools/mesh/tissue_levels.h"

namespace toothprep {
namespace {

using Edges = std::vector<std::array<std::uint32_t, 2>>;

constexpr int kRings = 2;  // of triangles about a border in which tissues are found anew
constexpr double kShortVoxels = 0.02;  // an edge that is not divided

class Division {
 public:
  Division(SharpSurface& surface, const LayeredTooth& tooth)
      : surface_(surface), mesh_(surface.mesh), tooth_(tooth), known_(mesh_.vertices.size(), -1) {}

  void run() {
    find_tissues();
    cross_edges();
    place_crossings();
    divide_triangles();
    divide_lines(surface_.margin);
    divide_lines(surface_.creases);
  }

 private:
  struct Crossing {
    std::array<std::uint32_t, 2> edge;
    std::array<std::uint8_t, 2> tissue;  // of its ends
  };
  using Triangle = std::array<std::uint32_t, 3>;

  void find_tissues();
  void learn(const std::vector<std::uint32_t>& vertices);
  bool learn_of_borders();
  std::uint32_t first_joined(std::uint32_t vertex) const;
  void join_short_edges();
  void cross_edges();
  void place_crossings();
  void divide_triangles();
  void divide_in_two(const Triangle& t, std::vector<Triangle>& triangles,
                     std::vector<std::uint8_t>& tissue) const;
  void divide_in_three(const Triangle& t, std::vector<Triangle>& triangles,
                       std::vector<std::uint8_t>& tissue);
  void divide_lines(Edges& lines) const;

  bool mixed(const Triangle& t) const {
    return mesh_.tissue[t[0]] != mesh_.tissue[t[1]] || mesh_.tissue[t[1]] != mesh_.tissue[t[2]];
  }
  static std::uint64_t key(std::uint32_t a, std::uint32_t b) {
    return static_cast<std::uint64_t>(std::min(a, b)) << 32 | std::max(a, b);
  }
  std::uint32_t crossing(std::uint32_t a, std::uint32_t b) const { return number_.at(key(a, b)); }
  Vec3 in_voxels(std::uint32_t v) const {
    return tooth_.lattice.to_index(mesh_.vertices[v].cast<double>());
  }
  float square_distance(std::uint32_t a, std::uint32_t b) const {
    return (mesh_.vertices[a] - mesh_.vertices[b]).squaredNorm();
  }
  Vec3 place_of(const Crossing& c) const;

  SharpSurface& surface_;
  TriangleMesh& mesh_;
  const LayeredTooth& tooth_;
  std::vector<std::int32_t> known_;                // per vertex: its place among distances_, or -1
  std::vector<TissueDistances> distances_;         // of the vertices near a border
  std::map<std::uint32_t, std::uint32_t> joined_;  // by a short edge, to one before
  std::vector<Crossing> crossings_;
  std::unordered_map<std::uint64_t, std::uint32_t> number_;  // of the vertex on an edge
};

// Near the borders that the vertices' labels show, and wherever these then turn out to run.
void Division::find_tissues() {
  std::vector<char> near(mesh_.vertices.size(), 0);
  for (const Triangle& t : mesh_.triangles)
    if (mixed(t)) near[t[0]] = near[t[1]] = near[t[2]] = 1;
  for (int ring = 1; ring <= kRings; ++ring)
    for (const Triangle& t : mesh_.triangles)
      if (std::any_of(t.begin(), t.end(), [&](auto v) { return near[v] == ring; }))
        for (const std::uint32_t v : t)
          if (near[v] == 0) near[v] = static_cast<char>(ring + 1);
  std::vector<std::uint32_t> vertices;
  for (std::uint32_t v = 0; v < near.size(); ++v)
    if (near[v] != 0) vertices.push_back(v);
  learn(vertices);
  do {
    while (learn_of_borders()) {
    }
    join_short_edges();
  } while (learn_of_borders());
}

// What isn't known of the vertices of triangles over which a border runs. False if all is.
bool Division::learn_of_borders() {
  std::vector<std::uint32_t> vertices;
  for (const Triangle& t : mesh_.triangles)
    if (mixed(t))
      for (const std::uint32_t v : t)
        if (known_[v] < 0) vertices.push_back(v);
  std::sort(vertices.begin(), vertices.end());
  vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
  learn(vertices);
  return !vertices.empty();
}

void Division::learn(const std::vector<std::uint32_t>& vertices) {
  const std::size_t before = distances_.size();
  distances_.resize(before + vertices.size());
  tbb::parallel_for(std::size_t{0}, vertices.size(), [&](std::size_t i) {
    const std::uint32_t v = vertices[i];
    known_[v] = static_cast<std::int32_t>(before + i);
    TissueDistances& its = distances_[before + i];
    if (const auto found = tissue_distances(tooth_, in_voxels(v))) {
      its = *found;
      mesh_.tissue[v] = static_cast<std::uint8_t>(nearest_tissue(its));
      return;
    }
    its.fill(0.5);  // as good as any: half a voxel
    if (mesh_.tissue[v] > 0) its[mesh_.tissue[v] - 1] = -0.5;
  });
}

std::uint32_t Division::first_joined(std::uint32_t v) const {
  for (auto at = joined_.find(v); at != joined_.end(); at = joined_.find(v)) v = at->second;
  return v;
}

// Vertices that short edges join have the tissue of the first of them.
void Division::join_short_edges() {
  const auto least = static_cast<float>(kShortVoxels * tooth_.lattice.voxel);
  for (bool changed = true; changed;) {
    changed = false;
    for (const Triangle& t : mesh_.triangles) {
      if (!mixed(t)) continue;
      for (int k = 0; k < 3; ++k) {
        const std::uint32_t p = t[k], q = t[(k + 1) % 3];
        if (mesh_.tissue[p] == mesh_.tissue[q] || square_distance(p, q) > least * least) continue;
        const auto [a, b] = std::minmax({first_joined(p), first_joined(q)});
        if (a == b) continue;
        joined_[b] = a;
        changed = true;
      }
    }
    for (const auto& [v, to] : joined_) mesh_.tissue[v] = mesh_.tissue[first_joined(to)];
  }
}

// Numbers the edges between two tissues in the order of the triangles.
void Division::cross_edges() {
  auto next = static_cast<std::uint32_t>(mesh_.vertices.size());
  for (const Triangle& t : mesh_.triangles) {
    if (!mixed(t)) continue;
    for (int k = 0; k < 3; ++k) {
      const auto [a, b] = std::minmax(t[k], t[(k + 1) % 3]);
      if (mesh_.tissue[a] == mesh_.tissue[b] || !number_.try_emplace(key(a, b), next).second)
        continue;
      ++next;
      crossings_.push_back({{a, b}, {mesh_.tissue[a], mesh_.tissue[b]}});
    }
  }
}

void Division::place_crossings() {
  const std::size_t before = mesh_.vertices.size();
  mesh_.vertices.resize(before + crossings_.size());
  for (const Crossing& c : crossings_) mesh_.tissue.push_back(std::min(c.tissue[0], c.tissue[1]));
  tbb::parallel_for(std::size_t{0}, crossings_.size(), [&](std::size_t i) {
    const Vec3 at = place_of(crossings_[i]);
    mesh_.vertices[before + i] = at.cast<float>();
  });
}

// By linear interpolation, and once more from there.
Vec3 Division::place_of(const Crossing& c) const {
  const auto [a, b] = c.edge;
  const auto first = [&](const TissueDistances& d) {  // negative in the first one's tissue
    return d[c.tissue[0] - 1] - d[c.tissue[1] - 1];
  };
  const auto clear = [](double t) { return std::clamp(t, kEdgeMargin, 1 - kEdgeMargin); };
  // Labels of joined ends may contradict the distances: then near that end.
  const double at_a = std::min(first(distances_[known_[a]]), -1e-9),
               at_b = std::max(first(distances_[known_[b]]), 1e-9);
  double t = clear(at_a / (at_a - at_b));
  const Vec3 from = in_voxels(a), along = in_voxels(b) - from;
  if (const auto there = tissue_distances(tooth_, from + t * along)) {
    const double between = first(*there);
    t = clear(between < 0 ? t + (1 - t) * between / (between - at_b) : t * at_a / (at_a - between));
  }
  return tooth_.lattice.origin + tooth_.lattice.voxel * (from + t * along);
}

void Division::divide_triangles() {
  std::vector<Triangle> triangles;
  std::vector<std::uint8_t> tissue;
  triangles.reserve(mesh_.triangles.size() + 2 * crossings_.size());
  tissue.reserve(triangles.capacity());
  for (const Triangle& t : mesh_.triangles) {
    const std::uint8_t a = mesh_.tissue[t[0]], b = mesh_.tissue[t[1]], c = mesh_.tissue[t[2]];
    if (a == b && b == c) {
      triangles.push_back(t);
      tissue.push_back(a);
    } else if (a != b && b != c && c != a) {
      divide_in_three(t, triangles, tissue);
    } else {
      const int alone = b == c ? 0 : c == a ? 1 : 2;
      divide_in_two({t[alone], t[(alone + 1) % 3], t[(alone + 2) % 3]}, triangles, tissue);
    }
  }
  mesh_.triangles = std::move(triangles);
  mesh_.triangle_tissue = std::move(tissue);
}

// The first corner is of another tissue than the others.
void Division::divide_in_two(const Triangle& t, std::vector<Triangle>& triangles,
                             std::vector<std::uint8_t>& tissue) const {
  const std::uint32_t p = crossing(t[0], t[1]), q = crossing(t[0], t[2]);
  triangles.push_back({t[0], p, q});
  tissue.push_back(mesh_.tissue[t[0]]);
  if (square_distance(p, t[2]) <= square_distance(q, t[1])) {
    triangles.push_back({p, t[1], t[2]});
    triangles.push_back({p, t[2], q});
  } else {
    triangles.push_back({p, t[1], q});
    triangles.push_back({q, t[1], t[2]});
  }
  tissue.insert(tissue.end(), 2, mesh_.tissue[t[1]]);
}

void Division::divide_in_three(const Triangle& t, std::vector<Triangle>& triangles,
                               std::vector<std::uint8_t>& tissue) {
  const Triangle on = {crossing(t[0], t[1]), crossing(t[1], t[2]), crossing(t[2], t[0])};
  const auto middle = static_cast<std::uint32_t>(mesh_.vertices.size());
  mesh_.vertices.push_back((mesh_.vertices[on[0]] + mesh_.vertices[on[1]] + mesh_.vertices[on[2]]) /
                           3);
  mesh_.tissue.push_back(std::min({mesh_.tissue[t[0]], mesh_.tissue[t[1]], mesh_.tissue[t[2]]}));
  for (int k = 0; k < 3; ++k) {
    triangles.push_back({t[k], on[k], middle});
    triangles.push_back({t[k], middle, on[(k + 2) % 3]});
    tissue.insert(tissue.end(), 2, mesh_.tissue[t[k]]);
  }
}

void Division::divide_lines(Edges& lines) const {
  const std::size_t count = lines.size();
  for (std::size_t i = 0; i < count; ++i) {
    const auto found = number_.find(key(lines[i][0], lines[i][1]));
    if (found == number_.end()) continue;
    lines.push_back({found->second, lines[i][1]});
    lines[i][1] = found->second;
  }
}

}  // namespace

void divide_by_tissue(SharpSurface& surface, const LayeredTooth& tooth) {
  Division(surface, tooth).run();
}

SharpSurface surface_by_tissue(const LayeredTooth& tooth) {
  SharpSurface surface = tooth.parts
                             ? extract_sharp_surface(tooth)
                             : SharpSurface{extract_surface(tooth, SurfaceOf::kAll), {}, {}};
  divide_by_tissue(surface, tooth);
  return surface;
}

std::vector<TissueBorder> tissue_borders(const TriangleMesh& mesh) {
  std::vector<std::uint8_t> about(mesh.vertices.size(), 0);  // tissues of its triangles, as bits
  const auto bit = [&](std::size_t t) {
    return static_cast<std::uint8_t>(1U << mesh.triangle_tissue[t]);
  };
  for (std::size_t t = 0; t < mesh.triangle_tissue.size(); ++t)
    for (const std::uint32_t v : mesh.triangles[t]) about[v] |= bit(t);
  const auto on_border = [&](std::uint32_t v) { return (about[v] & (about[v] - 1)) != 0; };
  std::map<std::array<std::uint32_t, 2>, Tissue> one_side;
  std::map<std::array<Tissue, 2>, Edges> borders;
  for (std::size_t t = 0; t < mesh.triangle_tissue.size(); ++t)
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [a, b] = std::minmax(mesh.triangles[t][k], mesh.triangles[t][(k + 1) % 3]);
      if (!on_border(a) || !on_border(b)) continue;
      const auto tissue = static_cast<Tissue>(mesh.triangle_tissue[t]);
      const auto [other, is_new] = one_side.try_emplace({a, b}, tissue);
      if (!is_new && other->second != tissue)
        borders[{std::min(tissue, other->second), std::max(tissue, other->second)}].push_back(
            {a, b});
    }
  std::vector<TissueBorder> result;
  for (auto& [between, edges] : borders) {
    std::sort(edges.begin(), edges.end());
    result.push_back({between, std::move(edges)});
  }
  return result;
}

}  // namespace toothprep
