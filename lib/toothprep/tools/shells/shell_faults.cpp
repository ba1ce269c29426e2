// What keeps a shell from bounding a solid. Topology by the edges; whether faces intersect or have an
// area by CGAL's exact predicates.
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <numeric>

#include "toothprep/tools/shells/shell_topology.h"
#include "toothprep/tools/shells/shells.h"

namespace toothprep {
namespace {

using namespace shell_topology;

constexpr std::size_t kNamed = 3;  // faults of a kind that are named with their place

// "first; second; third; and 12 more of the kind"
void add_capped(std::vector<std::string>& all, const std::vector<std::string>& kind) {
  for (std::size_t k = 0; k < std::min(kind.size(), kNamed); ++k) all.push_back(kind[k]);
  if (kind.size() > kNamed)
    all.push_back("and " + std::to_string(kind.size() - kNamed) + " more like it");
}

bool has_area(const Shell& shell, std::size_t t) {
  const auto& v = shell.triangles[t];
  return v[0] != v[1] && v[1] != v[2] && v[2] != v[0] &&
         !CGAL::collinear(cgal(shell.points[v[0]]), cgal(shell.points[v[1]]),
                          cgal(shell.points[v[2]]));
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
  kind.clear();
  for (const auto& [f, g] : intersecting_faces(shell, m))
    kind.push_back("faces " + std::to_string(shell.face[f]) + " and " +
                   std::to_string(shell.face[g]) + " intersect at " +
                   at(0.5 * (centre(shell, f) + centre(shell, g))));
  add_capped(faults, kind);
  if (!faults.empty()) return faults;
  const auto wrong = inside_out(m.mesh);
  if (wrong.size() == shell.triangles.size())
    faults.emplace_back("is inside out: its faces look inward");
  else if (!wrong.empty())
    faults.push_back("a part of " + count_of(wrong.size(), "face", "faces") + ", with " +
                     face_at(shell, wrong[0]) + ", is inside out");
  return faults;
}

}  // namespace toothprep
