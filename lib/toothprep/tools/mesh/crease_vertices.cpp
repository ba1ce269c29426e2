#include "toothprep/tools/mesh/crease_vertices.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>

#include "toothprep/tools/mesh/crossing_triangles.h"

namespace toothprep {
namespace {

constexpr double kBackStep = 0.25;  // of a vertex's way
constexpr double kOnLine = 0.002;   // of a triangle's longest edge, its height

using FloatBox = Eigen::AlignedBox3f;

}  // namespace

// Triangles by the cells of a coarse lattice that their boxes touch, wherever their vertices are
// on their ways.
class CreaseVertices::Neighbours {
 public:
  Neighbours(const TriangleMesh& mesh, const std::vector<FloatBox>& reach, double voxel)
      : mesh_(mesh), reach_(reach), cell_(static_cast<float>(kCell * voxel)) {
    for (const FloatBox& box : reach) all_.extend(box);
    for (int k = 0; k < 3; ++k)
      counts_[k] = static_cast<std::int64_t>((all_.max()[k] - all_.min()[k]) / cell_) + 1;
  }
  // Only cells that one of these touches are kept.
  void keep(const std::vector<std::size_t>& triangles) {
    for (const std::size_t t : triangles)
      for_cells(box_of(t), [&](std::int64_t cell) { cells_.push_back(cell); });
    std::sort(cells_.begin(), cells_.end());
    cells_.erase(std::unique(cells_.begin(), cells_.end()), cells_.end());
    std::vector<bool> is_kept(static_cast<std::size_t>(counts_[0] * counts_[1] * counts_[2]));
    for (const std::int64_t cell : cells_) is_kept[static_cast<std::size_t>(cell)] = true;
    for (std::size_t t = 0; t < mesh_.triangles.size(); ++t)
      for_cells(box_of(t), [&](std::int64_t cell) {
        if (is_kept[static_cast<std::size_t>(cell)]) entries_.push_back({cell, t});
      });
    std::sort(entries_.begin(), entries_.end());
  }
  std::vector<std::size_t> of(std::size_t triangle) const {
    std::vector<std::size_t> its;
    const FloatBox box = box_of(triangle);
    for_cells(box, [&](std::int64_t cell) {
      auto e = std::lower_bound(entries_.begin(), entries_.end(), std::pair{cell, std::size_t{0}});
      for (; e != entries_.end() && e->first == cell; ++e)
        if (e->second != triangle && box.intersects(box_of(e->second))) its.push_back(e->second);
    });
    std::sort(its.begin(), its.end());
    its.erase(std::unique(its.begin(), its.end()), its.end());
    return its;
  }

 private:
  static constexpr double kCell = 2;  // voxels
  FloatBox box_of(std::size_t t) const {
    FloatBox box;
    for (const std::uint32_t v : mesh_.triangles[t]) box.extend(reach_[v]);
    return box;
  }
  template <class Function>
  void for_cells(const FloatBox& box, const Function& function) const {
    std::array<std::array<std::int64_t, 2>, 3> range;
    for (int k = 0; k < 3; ++k)
      range[k] = {static_cast<std::int64_t>((box.min()[k] - all_.min()[k]) / cell_),
                  static_cast<std::int64_t>((box.max()[k] - all_.min()[k]) / cell_)};
    for (std::int64_t x = range[0][0]; x <= range[0][1]; ++x)
      for (std::int64_t y = range[1][0]; y <= range[1][1]; ++y)
        for (std::int64_t z = range[2][0]; z <= range[2][1]; ++z)
          function((x * counts_[1] + y) * counts_[2] + z);
  }

  const TriangleMesh& mesh_;
  const std::vector<FloatBox>& reach_;
  float cell_;
  FloatBox all_;
  std::array<std::int64_t, 3> counts_{};
  std::vector<std::int64_t> cells_;
  std::vector<std::pair<std::int64_t, std::size_t>> entries_;
};

void CreaseVertices::add(std::uint32_t vertex, const Vec3& to) {
  its_.push_back({vertex, {}, {}, at(vertex), to, 1, 1, true});
}

void CreaseVertices::add_dividing(std::uint32_t vertex, const std::vector<std::uint32_t>& corners,
                                  const std::vector<double>& weights, const Vec3& to) {
  its_.push_back({vertex, corners, weights, to, to, 1, 1, true});
}

void CreaseVertices::put_all() {
  for (Its& its : its_) {
    its.moved = its.part > 0;
    if (!its.corners.empty()) {
      its.from.setZero();
      for (std::size_t k = 0; k < its.corners.size(); ++k) {
        its.from += its.weights[k] * at(its.corners[k]);
        its.moved = its.moved || is_moved(its.corners[k]);
      }
    }
    mesh_.vertices[its.vertex] = (its.from + its.part * (its.to - its.from)).cast<float>();
  }
}

// A vertex reaches all places of its way. Leaves them at its end.
std::vector<FloatBox> CreaseVertices::reach() {
  std::vector<FloatBox> reach(mesh_.vertices.size());
  for (const bool at_end : {false, true}) {
    for (Its& its : its_) its.part = at_end ? its.most : 0;
    put_all();
    for (std::size_t v = 0; v < reach.size(); ++v) reach[v].extend(mesh_.vertices[v]);
  }
  return reach;
}

// Of which a corner was moved, or that were flipped.
bool CreaseVertices::is_changed(std::size_t t) const {
  const auto& corners = mesh_.triangles[t];
  return corners != as_given_[t] ||
         std::any_of(corners.begin(), corners.end(), [&](auto v) { return is_moved(v); });
}

std::vector<std::size_t> CreaseVertices::moved_triangles() const {
  std::vector<std::size_t> moved;
  for (std::size_t t = 0; t < mesh_.triangles.size(); ++t)
    if (is_changed(t)) moved.push_back(t);
  return moved;
}

Vec3 CreaseVertices::normal(const std::array<std::uint32_t, 3>& t) const {
  return (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])).normalized();
}

bool CreaseVertices::is_on_line(std::size_t t) const {
  const auto& c = mesh_.triangles[t];
  const Vec3 a = at(c[0]), b = at(c[1]), d = at(c[2]);
  const double longest =
      std::max({(b - a).squaredNorm(), (d - b).squaredNorm(), (a - d).squaredNorm()});
  return (b - a).cross(d - a).norm() < kOnLine * longest;
}

// Replaces edges of triangles by the other diagonals of both their triangles.
class CreaseVertices::Flips {
 public:
  Flips(CreaseVertices& vertices, const LooksWell& looks_well, const MayFlip& may_flip,
        const std::vector<std::size_t>& folded, bool lines_count)
      : vertices_(vertices),
        triangles_(vertices.mesh_.triangles),
        looks_well_(looks_well),
        may_flip_(may_flip),
        lines_count_(lines_count) {
    constexpr int kRings = 4;
    std::vector<bool> near(vertices.mesh_.vertices.size());
    for (const std::size_t t : folded)
      for (const std::uint32_t v : triangles_[t]) near[v] = true;
    for (int ring = 0; ring < kRings; ++ring) {
      const std::vector<bool> before = near;
      for (const auto& t : triangles_)
        if (before[t[0]] || before[t[1]] || before[t[2]])
          near[t[0]] = near[t[1]] = near[t[2]] = true;
    }
    for (std::size_t t = 0; t < triangles_.size(); ++t)
      for (const std::uint32_t v : triangles_[t])
        if (near[v]) about_[v].push_back(t);
  }
  // If the edges opposite to one of its corners can be replaced, from one triangle to the next, so
  // that less is folded. Adds the triangles that are folded after it.
  bool mend(std::size_t triangle, std::vector<std::size_t>& left) {
    const std::array<std::uint32_t, 3> corners = triangles_[triangle];
    for (const std::uint32_t apex : corners) {
      gained_ = 0;
      done_.clear();
      follow(triangle, apex, 0);
      if (gained_ > 0) {
        for (const Flip& f : done_) left.insert(left.end(), {f.triangle[0], f.triangle[1]});
        return true;
      }
      while (!done_.empty()) undo();
    }
    return false;
  }

 private:
  struct Flip {
    std::array<std::size_t, 2> triangle;
    std::array<std::array<std::uint32_t, 3>, 2> before;
    std::uint32_t apex, a, b, opposite;
  };
  bool has(std::size_t t, std::uint32_t v) const {
    const auto& c = triangles_[t];
    return c[0] == v || c[1] == v || c[2] == v;
  }
  // Twice the area of a triangle that looks elsewhere. One whose corners lie on a line, as three of
  // a margin can, may look anywhere: a little, if it counts.
  double folded_area(std::size_t t) const {
    const auto& c = triangles_[t];
    const Vec3 a = vertices_.at(c[0]), b = vertices_.at(c[1]),
               twice = (b - a).cross(vertices_.at(c[2]) - a);
    if (!looks_well_(t, twice.normalized())) return twice.norm();
    return lines_count_ && vertices_.is_on_line(t) ? kOnLine * (b - a).squaredNorm() : 0;
  }
  void follow(std::size_t triangle, std::uint32_t apex, int depth) {
    constexpr int kDeepest = 6;
    if (depth > kDeepest || folded_area(triangle) == 0 || !flip(triangle, apex)) return;
    const std::array<std::size_t, 2> both = done_.back().triangle;
    for (const std::size_t t : both) follow(t, apex, depth + 1);
  }
  bool flip(std::size_t t, std::uint32_t apex) {
    const auto own = triangles_[t];
    const auto k = static_cast<std::size_t>(std::find(own.begin(), own.end(), apex) - own.begin());
    const std::uint32_t a = own[(k + 1) % 3], b = own[(k + 2) % 3];
    const auto& beside = about_[a];
    const auto other = std::find_if(beside.begin(), beside.end(),
                                    [&](std::size_t s) { return s != t && has(s, b); });
    if (other == beside.end() || !may_flip_(t, *other, {a, b})) return false;
    const std::size_t s = *other;
    const auto its = triangles_[s];
    const std::uint32_t opposite = its[0] + its[1] + its[2] - a - b;
    const auto& joined = about_[apex];
    if (opposite == apex ||
        std::any_of(joined.begin(), joined.end(), [&](std::size_t u) { return has(u, opposite); }))
      return false;
    gained_ += folded_area(t) + folded_area(s);
    triangles_[t] = {apex, a, opposite};
    triangles_[s] = {apex, opposite, b};
    gained_ -= folded_area(t) + folded_area(s);
    std::erase(about_[b], t);
    std::erase(about_[a], s);
    about_[opposite].push_back(t);
    about_[apex].push_back(s);
    done_.push_back({{t, s}, {own, its}, apex, a, b, opposite});
    return true;
  }
  void undo() {
    const Flip& f = done_.back();
    const auto [t, s] = f.triangle;
    std::erase(about_[f.opposite], t);
    std::erase(about_[f.apex], s);
    about_[f.b].push_back(t);
    about_[f.a].push_back(s);
    for (int k = 0; k < 2; ++k) triangles_[f.triangle[k]] = f.before[k];
    done_.pop_back();
  }

  CreaseVertices& vertices_;
  std::vector<std::array<std::uint32_t, 3>>& triangles_;
  const LooksWell& looks_well_;
  const MayFlip& may_flip_;
  bool lines_count_;
  std::unordered_map<std::uint32_t, std::vector<std::size_t>> about_;  // triangles at a vertex
  double gained_ = 0;                                                  // of folded area, by these
  std::vector<Flip> done_;
};

void CreaseVertices::flip_folded(std::vector<std::size_t> folded, const LooksWell& looks_well,
                                 const MayFlip& may_flip, bool lines_count) {
  constexpr int kPasses = 20;
  const auto is_folded = [&](std::size_t t) {
    return !looks_well(t, normal(mesh_.triangles[t])) || (lines_count && is_on_line(t));
  };
  std::erase_if(folded, [&](std::size_t t) { return !is_folded(t); });
  if (folded.empty()) return;
  Flips flips(*this, looks_well, may_flip, folded, lines_count);
  for (int pass = 0; pass < kPasses && !folded.empty(); ++pass) {
    std::vector<std::size_t> left;
    for (const std::size_t t : folded)
      if (is_folded(t) && !flips.mend(t, left)) left.push_back(t);
    folded = left;
  }
}

// At these and at what they cross. Of pairs those count of which one is changed.
void CreaseVertices::look_at(const std::vector<std::size_t>& triangles,
                             const Neighbours& neighbours, const LooksWell& looks_well,
                             Seen& seen) const {
  std::vector<bool> among(mesh_.triangles.size());
  for (const std::size_t t : triangles) among[t] = true;
  std::erase_if(seen.crossing, [&](const auto& p) { return among[p[0]] || among[p[1]]; });
  seen.elsewhere.resize(mesh_.triangles.size());
  std::vector<std::vector<std::size_t>> crossed(triangles.size());
  tbb::parallel_for(std::size_t{0}, triangles.size(), [&](std::size_t k) {
    const std::size_t t = triangles[k];
    const bool changed = is_changed(t);
    seen.elsewhere[t] = changed && !looks_well(t, normal(mesh_.triangles[t]));
    for (const std::size_t other : neighbours.of(t)) {
      const bool has_its_turn = other < t && among[other];
      if (!has_its_turn && (changed || is_changed(other)) && cross(mesh_, t, other))
        crossed[k].push_back(other);
    }
  });
  for (std::size_t k = 0; k < triangles.size(); ++k)
    for (const std::size_t other : crossed[k]) seen.crossing.push_back({triangles[k], other});
}

CreaseVertices::Bad CreaseVertices::bad_among(const std::vector<std::size_t>& triangles,
                                              const Seen& seen) const {
  std::vector<std::size_t> place(mesh_.triangles.size(), triangles.size());
  Bad bad(triangles.size());
  for (std::size_t k = 0; k < triangles.size(); ++k) {
    const std::size_t t = triangles[k];
    if (!is_changed(t)) continue;
    place[t] = k;
    if (seen.elsewhere[t]) bad[k] = {t};
  }
  for (const auto& pair : seen.crossing)
    for (const std::size_t t : pair)
      if (place[t] < bad.size())
        bad[place[t]].insert(bad[place[t]].end(), pair.begin(), pair.end());
  std::erase_if(bad, [](const auto& its) { return its.empty(); });
  return bad;
}

std::vector<bool> CreaseVertices::corners_of(const Bad& bad) const {
  std::vector<bool> corners(mesh_.vertices.size());
  for (const auto& its : bad)
    for (const std::size_t t : its)
      for (const std::uint32_t v : mesh_.triangles[t]) corners[v] = true;
  return corners;
}

// The vertices of such triangles, those that divide first. False if there are none.
bool CreaseVertices::move_back(const Bad& bad) {
  std::vector<bool> to_move(its_.size());
  bool any = false;
  for (const auto& triangles : bad)
    for (const bool dividing : {true, false}) {
      bool found = false;
      for (const std::size_t t : triangles)
        for (const std::uint32_t v : mesh_.triangles[t])
          if (index_[v] >= 0 && its_[index_[v]].part > 0 &&
              its_[index_[v]].corners.empty() != dividing)
            found = to_move[index_[v]] = true;
      any = any || found;
      if (found) break;
    }
  for (std::size_t k = 0; k < its_.size(); ++k)
    if (to_move[k]) its_[k].part -= kBackStep;
  return any;
}

// Back at their places in the mesh as it was, nothing crosses; so if some can't be mended otherwise,
// the vertices there stay, and all is done again.
void CreaseVertices::place(const LooksWell& looks_well, const MayFlip& may_flip) {
  index_.assign(mesh_.vertices.size(), -1);
  for (std::size_t k = 0; k < its_.size(); ++k)
    index_[its_[k].vertex] = static_cast<std::int32_t>(k);
  as_given_ = mesh_.triangles;
  for (;;) {
    const Bad bad = try_to_place(looks_well, may_flip);
    if (bad.empty()) return;
    const std::vector<bool> at_bad = corners_of(bad);
    std::vector<bool> there = at_bad;
    for (const auto& t : mesh_.triangles)
      if (at_bad[t[0]] || at_bad[t[1]] || at_bad[t[2]])
        there[t[0]] = there[t[1]] = there[t[2]] = true;
    bool any = false;
    for (Its& its : its_)
      if (there[its.vertex] && its.most > 0) {
        its.most = 0;
        any = true;
      }
    if (!any) return;
    mesh_.triangles = as_given_;
  }
}

// What still crosses when all are where they were.
CreaseVertices::Bad CreaseVertices::try_to_place(const LooksWell& looks_well,
                                                 const MayFlip& may_flip) {
  const std::vector<FloatBox> its_reach = reach();
  std::vector<std::size_t> all;
  std::optional<Neighbours> neighbours;
  const auto find_neighbours = [&] {
    all = moved_triangles();
    neighbours.emplace(mesh_, its_reach, voxel_);
    neighbours->keep(all);
  };
  flip_folded(moved_triangles(), looks_well, may_flip, false);
  find_neighbours();
  Seen seen;
  look_at(all, *neighbours, looks_well, seen);
  Bad bad = bad_among(all, seen);
  if (bad.empty()) return bad;
  const std::vector<bool> there = corners_of(bad);
  std::erase_if(all, [&](std::size_t t) {
    const auto& c = mesh_.triangles[t];
    return !(there[c[0]] || there[c[1]] || there[c[2]]);
  });
  const auto unflipped = mesh_.triangles;
  flip_folded(all, looks_well, may_flip, true);
  find_neighbours();
  std::vector<std::size_t> flipped;
  for (std::size_t t = 0; t < unflipped.size(); ++t)
    if (mesh_.triangles[t] != unflipped[t]) flipped.push_back(t);
  look_at(flipped, *neighbours, looks_well, seen);
  for (std::vector<std::size_t> changed = all;;) {
    bad = bad_among(changed, seen);
    const std::vector<Eigen::Vector3f> before = mesh_.vertices;
    if (!move_back(bad)) return bad_among(all, seen);
    put_all();
    changed.clear();
    for (const std::size_t t : all)
      if (std::any_of(mesh_.triangles[t].begin(), mesh_.triangles[t].end(),
                      [&](std::uint32_t v) { return mesh_.vertices[v] != before[v]; }))
        changed.push_back(t);
    look_at(changed, *neighbours, looks_well, seen);
  }
}

}  // namespace toothprep
