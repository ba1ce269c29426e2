// The cases of marching cubes: how the zero surface of a sampled field passes through one cell.
//
// A surface for printing, scoring, collision or a display needs a promise: closed, 2-manifold, no
// triangle through another. The usual case table with an arbitrary triangulation does not give it,
// so the cases are derived from three rules:
//  1. On a cell's face, cuts separate the inside corners. The rule looks at the face only, so both
//     cells of a face draw the same segments: the surface closes, also where two blocks of cells
//     meet that were meshed apart. Each vertex sits in one loop per cell.
//  2. A loop is filled by a fan none of whose diagonals lies in a face of the cell. So what two
//     cells share is the segments of rule 1 and nothing else.
//  3. A vertex keeps away from the ends of its edge (kEdgeMargin), so no triangle is degenerate.
// Every loop has such a fan, and for every case the fans neither cross themselves nor each other
// wherever the vertices lie on their edges; the tests of the module `mesh` check it on noise, where
// all cases occur, with CGAL.
//
// Corner c of a cell has the coordinates (c & 1, c >> 1 & 1, c >> 2 & 1); a case is the set of its
// corners that lie inside, as bits. Edges are numbered by axis, then by lower corner.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

namespace toothprep {

// A crossing stays this part of an edge away from its ends. It moves the surface by at most 2 % of
// a voxel (2 µm at 0.1 mm), and only where it passes so close to a voxel's centre.
constexpr double kEdgeMargin = 0.02;

// Where on an edge the field is zero, 0 .. 1 from the end with value a to the end with value b, of
// opposite signs (rule 3).
inline double crossing_on_edge(double a, double b) {
  return std::clamp(a / (a - b), kEdgeMargin, 1 - kEdgeMargin);
}

struct CellEdge {
  int axis = 0, base = 0;  // runs from corner `base` along `axis`
};
struct CellLoop {
  int size = 0;
  std::array<std::uint8_t, 7> edge{};  // counter-clockwise seen from outside; the lowest first
  std::uint8_t apexes = 0;             // bits: corners of the loop from which it may be fanned
};
struct CellCase {
  int loops = 0, triangles = 0;
  std::array<CellLoop, 4> loop;  // by their first edges
};
struct CellCases {
  std::array<CellEdge, 12> edges;
  std::array<CellCase, 256> cases;
};

// Derived at the first call.
const CellCases& cell_cases();

// Of the allowed fans of a loop the apex of the one with the shortest diagonals, the first of
// equals. corners: the field at the cell's corners.
int fan_apex(const CellLoop& loop, const std::array<float, 8>& corners);

}  // namespace toothprep
