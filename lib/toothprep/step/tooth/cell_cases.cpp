#include "toothprep/step/tooth/cell_cases.h"

#include <limits>
#include <utility>

#include "toothprep/step/core/geometry.h"

namespace toothprep {
namespace {

bool on_one_face(const CellEdge& e, const CellEdge& f) {
  for (int axis = 0; axis < 3; ++axis)
    if (axis != e.axis && axis != f.axis && ((e.base ^ f.base) >> axis & 1) == 0) return true;
  return false;
}

CellCases derive_cases() {
  CellCases all;
  std::array<std::array<int, 8>, 8> edge_between{};
  int count = 0;
  for (int axis = 0; axis < 3; ++axis)
    for (int c = 0; c < 8; ++c)
      if ((c >> axis & 1) == 0) {
        edge_between[c][c | 1 << axis] = edge_between[c | 1 << axis][c] = count;
        all.edges[count++] = {axis, c};
      }
  for (int inside = 1; inside < 255; ++inside) {
    // Each face's segments, as a map from the edge where one starts to the edge where it ends.
    // Walking the corners of a face counter-clockwise seen from outside the cell, a run of inside
    // corners is entered over one edge and left over another: that is rule 1's segment.
    std::array<int, 12> next;
    next.fill(-1);
    for (int axis = 0; axis < 3; ++axis)
      for (int side = 0; side < 2; ++side) {
        const int u = 1 << (axis + 1) % 3, v = 1 << (axis + 2) % 3, base = side << axis;
        std::array<int, 4> corner = {base, base | u, base | u | v, base | v};
        if (side == 0) std::swap(corner[1], corner[3]);
        const auto is_inside = [&](int i) { return (inside >> corner[i % 4] & 1) != 0; };
        for (int i = 0; i < 4; ++i) {
          if (is_inside(i) || !is_inside(i + 1)) continue;
          int last = i + 1;
          while (is_inside(last + 1)) ++last;
          next[edge_between[corner[i]][corner[(i + 1) % 4]]] =
              edge_between[corner[last % 4]][corner[(last + 1) % 4]];
        }
      }
    CellCase& cell = all.cases[inside];
    for (int start = 0; start < 12; ++start) {
      if (next[start] < 0) continue;
      CellLoop& loop = cell.loop[cell.loops++];
      for (int e = start; next[e] >= 0;) {
        loop.edge[loop.size++] = static_cast<std::uint8_t>(e);
        e = std::exchange(next[e], -1);
      }
      for (int apex = 0; apex < loop.size; ++apex) {
        bool free_of_faces = true;
        for (int d = 2; d < loop.size - 1; ++d)
          free_of_faces &= !on_one_face(all.edges[loop.edge[apex]],
                                        all.edges[loop.edge[(apex + d) % loop.size]]);
        if (free_of_faces) loop.apexes = static_cast<std::uint8_t>(loop.apexes | 1 << apex);
      }
      cell.triangles += loop.size - 2;
    }
  }
  return all;
}

}  // namespace

const CellCases& cell_cases() {
  static const CellCases kCases = derive_cases();
  return kCases;
}

int fan_apex(const CellLoop& loop, const std::array<float, 8>& corners) {
  if (loop.size == 3) return 0;
  const CellCases& all = cell_cases();
  std::array<Vec3, 7> at;
  for (int i = 0; i < loop.size; ++i) {
    const CellEdge& edge = all.edges[loop.edge[i]];
    const double a = corners[edge.base], b = corners[edge.base | 1 << edge.axis];
    at[i] = Vec3(edge.base & 1, edge.base >> 1 & 1, edge.base >> 2);
    at[i][edge.axis] += a / (a - b);
  }
  int best = 0;
  double shortest = std::numeric_limits<double>::infinity();
  for (int apex = 0; apex < loop.size; ++apex) {
    if ((loop.apexes >> apex & 1) == 0) continue;
    double length = 0;
    for (int d = 2; d < loop.size - 1; ++d)
      length += (at[apex] - at[(apex + d) % loop.size]).squaredNorm();
    if (length < shortest - 1e-9) {
      shortest = length;
      best = apex;
    }
  }
  return best;
}

}  // namespace toothprep
