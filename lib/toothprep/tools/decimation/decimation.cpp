#include "toothprep/tools/decimation/decimation.h"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/decimation/edge_collapses.h"
#include "toothprep/tools/decimation/surface_distance.h"
#include "toothprep/tools/mesh/tissue_division.h"
#include "toothprep/tools/mesh/triangle_tree.h"

namespace toothprep {
namespace {

constexpr int kRounds = 8;
constexpr double kShare = 0.75;   // of the bound, for what is checked in passing
constexpr double kTighter = 0.5;  // where a round failed, the next allows so much of the distance
constexpr double kKept = 0.1;     // of the bound; less than this keeps the vertices as they are
constexpr int kKeptFrom = 2;      // so does failing in this round or later

// Marks the given vertices whose surroundings failed.
void mark(const Collapsed& result, const std::vector<std::uint32_t>& triangles,
          std::vector<char>& failed) {
  for (const std::uint32_t t : triangles)
    for (const std::uint32_t v : result.given[t]) failed[v] = 1;
}

void mark_corners(const TriangleMesh& given, const std::vector<std::uint32_t>& triangles,
                  std::vector<char>& failed) {
  for (const std::uint32_t t : triangles)
    for (const std::uint32_t v : given.triangles[t]) failed[v] = 1;
}

// Those of the triangles about each corner of these, too.
std::vector<std::uint32_t> with_neighbours(const TriangleMesh& mesh,
                                           const std::vector<std::uint32_t>& triangles) {
  std::vector<char> near(mesh.vertices.size(), 0);
  for (const std::uint32_t t : triangles)
    for (const std::uint32_t v : mesh.triangles[t]) near[v] = 1;
  std::vector<std::uint32_t> result;
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& c = mesh.triangles[t];
    if (near[c[0]] || near[c[1]] || near[c[2]]) result.push_back(t);
  }
  return result;
}

// Edges without a length have no place to go.
bool has_edge_without_length(const TriangleMesh& mesh) {
  return std::any_of(mesh.triangles.begin(), mesh.triangles.end(), [&](const auto& t) {
    const auto &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
    return a == b || b == c || c == a;
  });
}

struct Given {
  const TriangleMesh& mesh;
  TriangleTree tree;
  std::optional<bool> intersects = std::nullopt;  // looked for when it matters
};

struct Judgement {
  double greatest_mm = 0;
  std::vector<char> failed;  // per given vertex: its surroundings are to be decimated less
  bool good = true;
};

Judgement judge(const Collapsed& result, Given& given, double max_error_mm, bool widely) {
  const SurfaceDistance to = surface_distance(result.mesh, given.mesh, given.tree, max_error_mm);
  const SurfaceDistance from =
      surface_distance(given.mesh, result.mesh, TriangleTree(result.mesh), max_error_mm);
  std::vector<std::uint32_t> crossing = intersecting_triangles(result.mesh);
  if (!crossing.empty()) {
    if (!given.intersects) given.intersects = !intersecting_triangles(given.mesh).empty();
    if (*given.intersects) crossing.clear();
  }
  Judgement j;
  j.greatest_mm = std::max(to.greatest_mm, from.greatest_mm);
  j.failed.assign(given.mesh.vertices.size(), 0);
  j.good = to.beyond.empty() && from.beyond.empty() && crossing.empty();
  mark(result, to.beyond, j.failed);
  if (widely) mark(result, with_neighbours(result.mesh, to.beyond), j.failed);
  mark(result, with_neighbours(result.mesh, crossing), j.failed);
  mark_corners(given.mesh, from.beyond, j.failed);
  if (widely) mark_corners(given.mesh, with_neighbours(given.mesh, from.beyond), j.failed);
  return j;
}

using Lines = std::vector<std::array<std::uint32_t, 2>>;

std::array<std::uint32_t, 2> ascending(const std::array<std::uint32_t, 2>& edge) {
  return {std::min(edge[0], edge[1]), std::max(edge[0], edge[1])};
}

Lines border_edges(const TriangleMesh& mesh) {
  Lines edges;
  for (const TissueBorder& border : tissue_borders(mesh))
    edges.insert(edges.end(), border.edges.begin(), border.edges.end());
  std::sort(edges.begin(), edges.end());
  return edges;
}

// The lines, and besides the borders of the triangles' tissues.
Lines with_borders(const TriangleMesh& mesh, const Lines& lines) {
  Lines all = border_edges(mesh);
  for (const auto& edge : lines) all.push_back(ascending(edge));
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

Lines without_borders(const TriangleMesh& mesh, Lines lines) {
  const Lines borders = border_edges(mesh);
  std::erase_if(lines, [&](const auto& edge) {
    return std::binary_search(borders.begin(), borders.end(), ascending(edge));
  });
  return lines;
}

}  // namespace

Decimation decimate(const TriangleMesh& mesh, const Lines& lines, double max_error_mm) {
  if (!(max_error_mm >= kLeastMaxErrorMm && max_error_mm <= kGreatestMaxErrorMm))
    throw Error("the greatest error of a decimated mesh is not within its limits");
  Decimation decimation;
  decimation.mesh = mesh;
  decimation.lines = lines;
  if (has_edge_without_length(mesh)) return decimation;
  Given given{mesh, TriangleTree(mesh)};
  const Lines kept_lines = with_borders(mesh, lines);
  std::vector<double> tolerance(mesh.vertices.size(), kShare * max_error_mm);
  for (int round = 0; round < kRounds; ++round) {
    Collapsed result = collapse_edges(mesh, kept_lines, given.tree, tolerance, max_error_mm);
    const Judgement judgement = judge(result, given, max_error_mm, round > 0);
    if (judgement.good) {
      decimation.mesh = std::move(result.mesh);
      decimation.lines = without_borders(decimation.mesh, std::move(result.lines));
      decimation.decimated = true;
      decimation.greatest_mm = judgement.greatest_mm;
      decimation.greatest_of_lines_mm = result.greatest_of_lines_mm;
      return decimation;
    }
    for (std::size_t v = 0; v < tolerance.size(); ++v) {
      if (!judgement.failed[v]) continue;
      tolerance[v] *= kTighter;
      if (round >= kKeptFrom || tolerance[v] < kKept * max_error_mm) tolerance[v] = 0;
    }
  }
  return decimation;
}

}  // namespace toothprep
