#include "toothprep/tools/shells/shell_topology.h"

#include <CGAL/Polygon_mesh_processing/orientation.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <numeric>
#include <tuple>

#include "toothprep/step/core/errors.h"

namespace toothprep::shell_topology {

namespace pmp = CGAL::Polygon_mesh_processing;

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

std::string count_of(std::size_t n, const std::string& one, const std::string& many) {
  return n == 1 ? "1 " + one : std::to_string(n) + " " + many;
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

Parts parts_of(const Shell& shell, const std::vector<HalfEdge>& edges) {
  const std::size_t n = shell.triangles.size();
  std::vector<std::uint32_t> parent(n);
  std::iota(parent.begin(), parent.end(), 0U);
  for_each_edge(edges, [&](const HalfEdge* e, const HalfEdge* end) {
    for (const HalfEdge* other = e + 1; other < end; ++other)
      join(parent, e->corner / 3, other->corner / 3);
  });
  std::vector<double> area(n, 0);
  for (std::uint32_t t = 0; t < n; ++t) {
    const auto& v = shell.triangles[t];
    const Vec3& a = shell.points[v[0]];
    area[root_of(parent, t)] += 0.5 * (shell.points[v[1]] - a).cross(shell.points[v[2]] - a).norm();
  }
  std::vector<std::uint32_t> roots;
  for (std::uint32_t t = 0; t < n; ++t)
    if (root_of(parent, t) == t) roots.push_back(t);
  std::stable_sort(roots.begin(), roots.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return area[a] > area[b]; });
  Parts parts;
  std::vector<std::uint32_t> rank(n, 0);
  for (const std::uint32_t root : roots) {
    rank[root] = static_cast<std::uint32_t>(parts.area.size());
    parts.area.push_back(area[root]);
  }
  for (std::uint32_t t = 0; t < n; ++t) parts.of.push_back(rank[root_of(parent, t)]);
  return parts;
}

Shell kept_faces(const Shell& shell, const std::vector<char>& keep) {
  Shell kept;
  kept.file = shell.file;
  std::vector<std::uint32_t> number(shell.points.size(), ~0U);
  for (std::size_t t = 0; t < shell.triangles.size(); ++t) {
    if (!keep[t]) continue;
    std::array<std::uint32_t, 3> triangle;
    for (std::size_t c = 0; c < 3; ++c) {
      const std::uint32_t old = shell.triangles[t][c];
      if (number[old] == ~0U) {
        number[old] = static_cast<std::uint32_t>(kept.points.size());
        kept.points.push_back(shell.points[old]);
      }
      triangle[c] = number[old];
    }
    kept.triangles.push_back(triangle);
    kept.face.push_back(shell.face[t]);
  }
  return kept;
}

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

std::array<std::uint32_t, 3> corners(const Mesh& mesh, Mesh::Face_index f) {
  const auto h = mesh.halfedge(f);
  return {mesh.source(h).idx(), mesh.target(h).idx(), mesh.target(mesh.next(h)).idx()};
}

std::vector<std::pair<std::size_t, std::size_t>> intersecting_faces(const Shell& shell,
                                                                    const Meshed& m) {
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
  return true_pairs;
}

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

}  // namespace toothprep::shell_topology
