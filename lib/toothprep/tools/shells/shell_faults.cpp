// What keeps a shell from bounding a solid, and what of it can be repaired. Topology by the edges;
// whether faces intersect or have an area by CGAL's exact predicates.
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/border.h>
#include <CGAL/Polygon_mesh_processing/orientation.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/repair_degeneracies.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Polygon_mesh_processing/triangulate_hole.h>
#include <CGAL/Surface_mesh.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <numeric>
#include <tuple>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/shells/shells.h"

namespace toothprep {
namespace {

namespace pmp = CGAL::Polygon_mesh_processing;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Point = Kernel::Point_3;
using Mesh = CGAL::Surface_mesh<Point>;

constexpr double kLongestRim = 1.0;  // mm, of a hole that is filled
constexpr std::size_t kNamed = 3;    // faults of a kind that are named with their place

Point cgal(const Vec3& p) { return {p.x(), p.y(), p.z()}; }

std::string at(const Vec3& p) {
  return fmt::format("({:.3f}, {:.3f}, {:.3f}) mm", p.x(), p.y(), p.z());
}

Vec3 centre(const Shell& shell, std::size_t t) {
  const auto& v = shell.triangles[t];
  return (shell.points[v[0]] + shell.points[v[1]] + shell.points[v[2]]) / 3;
}

std::string face_at(const Shell& shell, std::size_t t) {
  return "face " + std::to_string(shell.face[t]) + " at " + at(centre(shell, t));
}

// "first; second; third; and 12 more of the kind"
void add_capped(std::vector<std::string>& all, const std::vector<std::string>& kind) {
  for (std::size_t k = 0; k < std::min(kind.size(), kNamed); ++k) all.push_back(kind[k]);
  if (kind.size() > kNamed)
    all.push_back("and " + std::to_string(kind.size() - kNamed) + " more like it");
}

std::uint32_t root_of(std::vector<std::uint32_t>& parent, std::uint32_t k) {
  while (parent[k] != k) k = parent[k] = parent[parent[k]];
  return k;
}
void join(std::vector<std::uint32_t>& parent, std::uint32_t a, std::uint32_t b) {
  a = root_of(parent, a);
  b = root_of(parent, b);
  parent[std::max(a, b)] = std::min(a, b);
}

struct HalfEdge {
  std::uint32_t low, high;  // points
  std::uint32_t corner;     // 3 * triangle + the corner it starts at
  bool forward;             // low to high

  bool same_edge(const HalfEdge& o) const { return low == o.low && high == o.high; }
};

std::vector<HalfEdge> half_edges(const Shell& shell) {
  std::vector<HalfEdge> edges;
  edges.reserve(3 * shell.triangles.size());
  for (std::size_t t = 0; t < shell.triangles.size(); ++t)
    for (std::size_t c = 0; c < 3; ++c) {
      const std::uint32_t u = shell.triangles[t][c], v = shell.triangles[t][(c + 1) % 3];
      edges.push_back(
          {std::min(u, v), std::max(u, v), static_cast<std::uint32_t>(3 * t + c), u < v});
    }
  std::sort(edges.begin(), edges.end(), [](const HalfEdge& a, const HalfEdge& b) {
    return std::tie(a.low, a.high, a.corner) < std::tie(b.low, b.high, b.corner);
  });
  return edges;
}

// use(first, last) for the half-edges of every edge.
template <class Use>
void for_each_edge(const std::vector<HalfEdge>& edges, Use&& use) {
  for (std::size_t k = 0; k < edges.size();) {
    std::size_t end = k + 1;
    while (end < edges.size() && edges[end].same_edge(edges[k])) ++end;
    use(&edges[k], &edges[0] + end);
    k = end;
  }
}

bool has_area(const Shell& shell, std::size_t t) {
  const auto& v = shell.triangles[t];
  return v[0] != v[1] && v[1] != v[2] && v[2] != v[0] &&
         !CGAL::collinear(cgal(shell.points[v[0]]), cgal(shell.points[v[1]]),
                          cgal(shell.points[v[2]]));
}

// For every triangle the first one with the same three points.
std::vector<std::uint32_t> first_alike(const Shell& shell) {
  const std::size_t n = shell.triangles.size();
  std::vector<std::array<std::uint32_t, 3>> sorted = shell.triangles;
  for (auto& t : sorted) std::sort(t.begin(), t.end());
  std::vector<std::uint32_t> order(n), first(n);
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return std::tie(sorted[a], a) < std::tie(sorted[b], b);
  });
  for (std::size_t k = 0; k < n; ++k)
    first[order[k]] =
        k > 0 && sorted[order[k]] == sorted[order[k - 1]] ? first[order[k - 1]] : order[k];
  return first;
}

// Which triangles must turn for neighbours to agree: the fewer ones of each part. Empty if a part
// has only one side (edges of more than two triangles are passed over).
struct Turn {
  bool possible = true;
  std::vector<char> triangle;
  std::size_t count = 0;
};
Turn turns_needed(const Shell& shell, const std::vector<HalfEdge>& edges) {
  const std::size_t n = shell.triangles.size();
  struct Link {
    std::uint32_t to;
    char disagree;
  };
  std::vector<std::array<Link, 3>> link(n, {Link{~0U, 0}, Link{~0U, 0}, Link{~0U, 0}});
  for_each_edge(edges, [&](const HalfEdge* e, const HalfEdge* end) {
    if (end - e != 2) return;
    const char disagree = e[0].forward == e[1].forward;
    link[e[0].corner / 3][e[0].corner % 3] = {e[1].corner / 3, disagree};
    link[e[1].corner / 3][e[1].corner % 3] = {e[0].corner / 3, disagree};
  });
  Turn turn;
  turn.triangle.assign(n, -1);
  std::vector<std::uint32_t> part;
  for (std::uint32_t start = 0; start < n; ++start) {
    if (turn.triangle[start] >= 0) continue;
    part.assign(1, start);
    turn.triangle[start] = 0;
    std::size_t turned = 0;
    for (std::size_t k = 0; k < part.size(); ++k) {
      const char own = turn.triangle[part[k]];
      turned += static_cast<std::size_t>(own);
      for (const Link& l : link[part[k]]) {
        if (l.to == ~0U) continue;
        const char wanted = own ^ l.disagree;
        if (turn.triangle[l.to] < 0) {
          turn.triangle[l.to] = wanted;
          part.push_back(l.to);
        } else if (turn.triangle[l.to] != wanted) {
          turn.possible = false;
        }
      }
    }
    if (2 * turned > part.size()) {
      for (const std::uint32_t t : part) turn.triangle[t] ^= 1;
      turned = part.size() - turned;
    }
    turn.count += turned;
  }
  return turn;
}

// CGAL's mesh of the shell, its faces in the same order. Where sheets meet in a single point, each
// sheet gets a point of its own; `point` is the shell's point of every vertex.
struct Meshed {
  Mesh mesh;
  std::vector<std::uint32_t> point;
};
Meshed meshed(const Shell& shell, const std::vector<HalfEdge>& edges) {
  const std::size_t n = shell.triangles.size();
  std::vector<std::uint32_t> parent(3 * n);  // of corners
  std::iota(parent.begin(), parent.end(), 0U);
  const auto next = [](std::uint32_t c) { return c % 3 == 2 ? c - 2 : c + 1; };
  for_each_edge(edges, [&](const HalfEdge* e, const HalfEdge* end) {
    if (end - e != 2) return;
    join(parent, e[0].corner, e[0].forward == e[1].forward ? e[1].corner : next(e[1].corner));
    join(parent, next(e[0].corner), e[0].forward == e[1].forward ? next(e[1].corner) : e[1].corner);
  });
  Meshed result;
  std::vector<Point> points;
  std::vector<std::uint32_t> number(3 * n, ~0U);
  std::vector<std::array<std::size_t, 3>> faces(n);
  for (std::uint32_t c = 0; c < 3 * n; ++c) {
    std::uint32_t& known = number[root_of(parent, c)];
    if (known == ~0U) {
      known = static_cast<std::uint32_t>(points.size());
      result.point.push_back(shell.triangles[c / 3][c % 3]);
      points.push_back(cgal(shell.points[result.point.back()]));
    }
    faces[c / 3][c % 3] = known;
  }
  pmp::polygon_soup_to_polygon_mesh(points, faces, result.mesh);
  if (num_faces(result.mesh) != n) throw Error(shell.file + ": its faces don't make a surface");
  return result;
}

std::vector<std::string> intersections(const Shell& shell, const Meshed& m) {
  std::vector<std::pair<Mesh::Face_index, Mesh::Face_index>> pairs;
  pmp::self_intersections<CGAL::Sequential_tag>(m.mesh, std::back_inserter(pairs));
  std::vector<std::pair<std::size_t, std::size_t>> true_pairs;
  for (const auto& [f, g] : pairs) {
    // Sheets that meet in one point only touch; the mesh can't know, it has two points there.
    const std::array<std::array<std::uint32_t, 3>, 2> v{shell.triangles[f], shell.triangles[g]};
    int shared = 0;
    std::array<std::size_t, 2> corner{};
    for (std::size_t a = 0; a < 3; ++a)
      for (std::size_t b = 0; b < 3; ++b)
        if (v[0][a] == v[1][b]) {
          ++shared;
          corner = {a, b};
        }
    if (shared == 1) {
      const auto p = [&](std::size_t t, std::size_t k) { return cgal(shell.points[v[t][k % 3]]); };
      bool meet = false;
      for (std::size_t t = 0; t < 2 && !meet; ++t)
        meet = CGAL::do_intersect(Kernel::Segment_3(p(t, corner[t] + 1), p(t, corner[t] + 2)),
                                  Kernel::Triangle_3(p(1 - t, 0), p(1 - t, 1), p(1 - t, 2)));
      if (!meet) continue;
    }
    true_pairs.emplace_back(std::min<std::size_t>(f, g), std::max<std::size_t>(f, g));
  }
  std::sort(true_pairs.begin(), true_pairs.end());
  std::vector<std::string> faults;
  faults.reserve(true_pairs.size());
  for (const auto& [f, g] : true_pairs)
    faults.push_back("faces " + std::to_string(shell.face[f]) + " and " +
                     std::to_string(shell.face[g]) + " intersect at " +
                     at(0.5 * (centre(shell, f) + centre(shell, g))));
  return faults;
}

std::array<std::uint32_t, 3> corners(const Mesh& mesh, Mesh::Face_index f) {
  const auto h = mesh.halfedge(f);
  return {mesh.source(h).idx(), mesh.target(h).idx(), mesh.target(mesh.next(h)).idx()};
}

// Triangles of parts that face the wrong way: outermost parts inward, cavities outward.
std::vector<std::size_t> inside_out(const Mesh& mesh) {
  if (mesh.number_of_faces() == 0) return {};  // CGAL takes the first part's turn unseen
  Mesh right = mesh;
  pmp::orient_to_bound_a_volume(right);
  std::vector<std::size_t> wrong;
  for (const auto f : mesh.faces()) {
    const auto a = corners(mesh, f), b = corners(right, f);
    const auto k = std::find(b.begin(), b.end(), a[0]) - b.begin();
    if (b[static_cast<std::size_t>((k + 1) % 3)] != a[1]) wrong.push_back(f);
  }
  return wrong;
}

std::string count_of(std::size_t n, const std::string& one, const std::string& many) {
  return n == 1 ? "1 " + one : std::to_string(n) + " " + many;
}

}  // namespace

std::vector<std::string> shell_faults(const Shell& shell) {
  if (shell.triangles.empty()) return {"holds no faces"};
  std::vector<std::string> faults, kind;
  const auto first = first_alike(shell);
  for (std::size_t t = 0; t < shell.triangles.size(); ++t) {
    if (!has_area(shell, t))
      kind.push_back(face_at(shell, t) + " has no area");
    else if (first[t] != t)
      kind.push_back(face_at(shell, t) + " is face " + std::to_string(shell.face[first[t]]) +
                     " again");
  }
  add_capped(faults, kind);

  // Holes: border edges that hang together, in the order of their first.
  kind.clear();
  const auto edges = half_edges(shell);
  std::vector<std::uint32_t> parent(shell.points.size());
  std::iota(parent.begin(), parent.end(), 0U);
  std::vector<std::string> crowded;
  std::vector<const HalfEdge*> border;
  for_each_edge(edges, [&](const HalfEdge* e, const HalfEdge* end) {
    if (e->low == e->high) return;
    if (end - e == 1) {
      border.push_back(e);
      join(parent, e->low, e->high);
    } else if (end - e > 2) {
      crowded.push_back(std::to_string(end - e) + " faces share an edge at " +
                        at(0.5 * (shell.points[e->low] + shell.points[e->high])));
    }
  });
  struct Rim {
    std::size_t edges = 0;
    double length = 0;
    Vec3 middle = Vec3::Zero();
  };
  std::map<std::uint32_t, Rim> rims;
  for (const HalfEdge* e : border) {
    const Vec3 &a = shell.points[e->low], &b = shell.points[e->high];
    Rim& rim = rims[root_of(parent, e->low)];
    ++rim.edges;
    rim.length += (b - a).norm();
    rim.middle += 0.5 * (a + b);
  }
  for (const auto& [point, rim] : rims) {
    kind.push_back(fmt::format("has a hole: {}, {:.3g} mm long, near {}",
                               count_of(rim.edges, "border edge", "border edges"), rim.length,
                               at(rim.middle / static_cast<double>(rim.edges))));
  }
  add_capped(faults, kind);
  add_capped(faults, crowded);

  kind.clear();
  const Turn turn = turns_needed(shell, edges);
  if (!turn.possible)
    kind.push_back("has a part with only one side, like a Moebius strip");
  else
    for (std::size_t t = 0; t < shell.triangles.size(); ++t)
      if (turn.triangle[t]) kind.push_back(face_at(shell, t) + " is flipped");
  add_capped(faults, kind);
  if (!faults.empty()) return faults;

  const Meshed m = meshed(shell, edges);
  add_capped(faults, intersections(shell, m));
  if (!faults.empty()) return faults;
  const auto wrong = inside_out(m.mesh);
  if (wrong.size() == shell.triangles.size())
    faults.emplace_back("is inside out: its faces look inward");
  else if (!wrong.empty())
    faults.push_back("a part of " + count_of(wrong.size(), "face", "faces") + ", with " +
                     face_at(shell, wrong[0]) + ", is inside out");
  return faults;
}

namespace {

// Faces that bound nothing go: two corners in one point, or a face given again. Returns how many.
std::size_t remove_idle_faces(Shell& shell) {
  const auto first = first_alike(shell);
  Shell kept;
  kept.file = shell.file;
  kept.points = shell.points;
  for (std::size_t t = 0; t < shell.triangles.size(); ++t) {
    const auto& v = shell.triangles[t];
    if (v[0] == v[1] || v[1] == v[2] || v[2] == v[0] || first[t] != t) continue;
    kept.triangles.push_back(v);
    kept.face.push_back(shell.face[t]);
  }
  const std::size_t gone = shell.triangles.size() - kept.triangles.size();
  if (gone > 0) shell = std::move(kept);
  return gone;
}

// Holes whose rim is short, one note each.
std::vector<std::string> fill_holes(Mesh& mesh) {
  std::vector<std::string> notes;
  std::vector<Mesh::Halfedge_index> rims;
  pmp::extract_boundary_cycles(mesh, std::back_inserter(rims));
  for (const auto start : rims) {
    double length = 0;
    Vec3 middle = Vec3::Zero();
    int count = 0;
    for (const auto h : CGAL::halfedges_around_face(start, mesh)) {
      const Point &p = mesh.point(mesh.source(h)), &q = mesh.point(mesh.target(h));
      length += std::sqrt(CGAL::squared_distance(p, q));
      middle += Vec3(p.x(), p.y(), p.z());
      ++count;
    }
    if (length >= kLongestRim) continue;
    std::vector<Mesh::Face_index> filled;
    pmp::triangulate_hole(mesh, start, std::back_inserter(filled));
    if (filled.empty()) continue;
    notes.push_back("filled a hole of " + std::to_string(count) + " edges near " +
                    at(middle / count) + " with " + count_of(filled.size(), "face", "faces"));
  }
  return notes;
}

std::size_t remove_flat_faces(Mesh& mesh) {
  std::size_t flat = 0;
  for (const auto f : mesh.faces())
    flat += static_cast<std::size_t>(pmp::is_degenerate_triangle_face(f, mesh));
  if (flat > 0) pmp::remove_degenerate_faces(mesh);
  return flat;
}

// Of a closed mesh without intersections. Returns how many faces were turned.
std::size_t turn_parts_outward(Mesh& mesh) {
  if (!CGAL::is_closed(mesh) || pmp::does_self_intersect<CGAL::Sequential_tag>(mesh)) return 0;
  mesh.collect_garbage();
  const auto wrong = inside_out(mesh);
  if (!wrong.empty()) pmp::orient_to_bound_a_volume(mesh);
  return wrong.size();
}

// Merges the points of touching sheets.
Shell shell_of(Mesh& mesh, const std::string& file) {
  mesh.collect_garbage();
  Shell shell;
  shell.file = file;
  std::map<std::array<double, 3>, std::uint32_t> number;
  for (const auto f : mesh.faces()) {
    std::array<std::uint32_t, 3> triangle;
    const auto v = corners(mesh, f);
    for (std::size_t c = 0; c < 3; ++c) {
      const Point& p = mesh.point(Mesh::Vertex_index(v[c]));
      const auto [place, fresh] = number.try_emplace(
          {p.x(), p.y(), p.z()}, static_cast<std::uint32_t>(shell.points.size()));
      if (fresh) shell.points.emplace_back(p.x(), p.y(), p.z());
      triangle[c] = place->second;
    }
    shell.triangles.push_back(triangle);
    shell.face.push_back(static_cast<std::uint32_t>(shell.triangles.size()));
  }
  return shell;
}

}  // namespace

std::vector<std::string> repair_shell(Shell& shell) {
  std::vector<std::string> notes;
  if (const std::size_t gone = remove_idle_faces(shell); gone > 0)
    notes.push_back("removed " + count_of(gone, "face", "faces") + " without area or given twice");

  auto edges = half_edges(shell);
  bool crowded = false, open = false;
  for_each_edge(edges, [&](const HalfEdge* e, const HalfEdge* end) {
    crowded = crowded || end - e > 2;
    open = open || end - e == 1;
  });
  const Turn turn = turns_needed(shell, edges);
  if (crowded || !turn.possible || shell.triangles.empty()) return notes;
  if (turn.count > 0) {
    for (std::size_t t = 0; t < shell.triangles.size(); ++t)
      if (turn.triangle[t]) std::swap(shell.triangles[t][1], shell.triangles[t][2]);
    notes.push_back("turned " + count_of(turn.count, "flipped face", "flipped faces"));
    edges = half_edges(shell);
  }

  Mesh mesh = meshed(shell, edges).mesh;
  const std::size_t before = notes.size();
  if (open)
    for (std::string& note : fill_holes(mesh)) notes.push_back(std::move(note));
  if (const std::size_t flat = remove_flat_faces(mesh); flat > 0)
    notes.push_back("removed " + count_of(flat, "face", "faces") + " without area");
  if (const std::size_t wrong = turn_parts_outward(mesh); wrong > 0)
    notes.push_back("turned " + count_of(wrong, "face", "faces") +
                    " of parts that were inside out");
  if (notes.size() > before) shell = shell_of(mesh, shell.file);
  return notes;
}

}  // namespace toothprep
