#include <algorithm>
#include <map>
#include <numeric>

#include "toothprep/tools/shells/closing.h"
#include "toothprep/tools/shells/shell_topology.h"

namespace toothprep {

using namespace shell_topology;

namespace {

struct RimPoints {
  std::vector<Vec3> points;
  double length = 0;
};

double widest(const std::vector<Vec3>& points) {
  constexpr std::size_t kPairs = 300;  // points whose distances are all compared
  const std::size_t step = std::max<std::size_t>(1, points.size() / kPairs);
  double square = 0;
  for (std::size_t i = 0; i < points.size(); i += step)
    for (std::size_t j = 0; j < i; j += step)
      square = std::max(square, (points[i] - points[j]).squaredNorm());
  return std::sqrt(square);
}

std::vector<ShellOpening> openings_of(const Shell& shell, const std::vector<HalfEdge>& edges) {
  std::vector<std::uint32_t> parent(shell.points.size());
  std::iota(parent.begin(), parent.end(), 0U);
  std::vector<const HalfEdge*> border;
  for_each_edge(edges, [&](const HalfEdge* e, const HalfEdge* end) {
    if (end - e != 1 || e->low == e->high) return;
    border.push_back(e);
    join(parent, e->low, e->high);
  });
  std::map<std::uint32_t, RimPoints> rims;
  for (const HalfEdge* e : border) {
    const Vec3 &a = shell.points[e->low], &b = shell.points[e->high];
    RimPoints& rim = rims[root_of(parent, e->low)];
    rim.points.push_back(0.5 * (a + b));
    rim.length += (b - a).norm();
  }
  std::vector<ShellOpening> openings;
  for (const auto& [root, rim] : rims) {
    ShellOpening opening;
    for (const Vec3& p : rim.points) opening.centre += p / static_cast<double>(rim.points.size());
    opening.width = widest(rim.points);
    opening.length = rim.length;
    opening.edges = rim.points.size();
    openings.push_back(opening);
  }
  std::stable_sort(openings.begin(), openings.end(),
                   [](const ShellOpening& a, const ShellOpening& b) { return a.width > b.width; });
  return openings;
}

}  // namespace

ShellSurvey survey_shell(const Shell& shell) {
  ShellSurvey survey;
  const auto edges = half_edges(shell);
  const Parts parts = parts_of(shell, edges);
  survey.parts.resize(parts.area.size());
  std::vector<char> met(survey.parts.size(), 0);
  for (std::size_t t = 0; t < shell.triangles.size(); ++t) {
    ShellPart& part = survey.parts[parts.of[t]];
    const auto& v = shell.triangles[t];
    const Vec3 &a = shell.points[v[0]], &b = shell.points[v[1]], &c = shell.points[v[2]];
    const Vec3 low = a.cwiseMin(b).cwiseMin(c), high = a.cwiseMax(b).cwiseMax(c);
    part.bounds = met[parts.of[t]]
                      ? Box{part.bounds.min.cwiseMin(low), part.bounds.max.cwiseMax(high)}
                      : Box{low, high};
    met[parts.of[t]] = 1;
    part.closed = true;
    ++part.triangles;
    // About a point of the shell, so that a far-off frame costs no digits.
    const Vec3& o = shell.points[0];
    part.volume_mm3 += (a - o).dot((b - o).cross(c - o)) / 6;
  }
  for (std::size_t p = 0; p < survey.parts.size(); ++p) survey.parts[p].area_mm2 = parts.area[p];
  for_each_edge(edges, [&](const HalfEdge* e, const HalfEdge* end) {
    if (end - e != 2) survey.parts[parts.of[e->corner / 3]].closed = false;
  });
  for (ShellPart& part : survey.parts)
    if (!part.closed) part.volume_mm3 = 0;
  survey.openings = openings_of(shell, edges);
  return survey;
}

}  // namespace toothprep
