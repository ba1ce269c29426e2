// One pass of edge collapses over a mesh, by CGAL; what it keeps is in decimation.h.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "toothprep/tools/mesh/surface.h"
#include "toothprep/tools/mesh/triangle_tree.h"

namespace toothprep {

struct Collapsed {
  TriangleMesh mesh;
  std::vector<std::array<std::uint32_t, 2>> lines;  // edges of the mesh
  double greatest_of_lines_mm = 0;
  std::vector<std::vector<std::uint32_t>> given;  // per triangle: the given vertices it replaces
};

// tolerance_mm: per vertex of the given mesh, how far from the present surface it may be; 0 keeps it.
// line_tolerance_mm: of the lines. Throws Error for a mesh that isn't closed and 2-manifold.
[[nodiscard]] Collapsed collapse_edges(const TriangleMesh& mesh,
                                       const std::vector<std::array<std::uint32_t, 2>>& lines,
                                       const TriangleTree& tree,
                                       const std::vector<double>& tolerance_mm,
                                       double line_tolerance_mm);

// Triangles that intersect another one, ascending; by exact predicates.
[[nodiscard]] std::vector<std::uint32_t> intersecting_triangles(const TriangleMesh& mesh);

}  // namespace toothprep
