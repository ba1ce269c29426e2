// Fewer triangles for the same surface, within a given distance of it.
//
// Edges are collapsed in the order of Lindstrom and Turk's cost (Proc IEEE Visualization 1998:
// 279-286; CGAL's Surface_mesh_simplification), each only if what it replaces stays near:
//   - every vertex of the given mesh belongs to a triangle of the present one, and lies within
//     3/4 E of it;
//   - new vertices, and the middles of new edges and triangles, lie within 3/4 E of the given surface;
//   - no triangle turns by more than 60 degrees or becomes a sliver;
//   - a feature line (the margin) keeps some of its own vertices, and each of its new edges lies
//     within E of all the vertices that it replaces, so both lines are within E of one another;
//   - so do the borders of tissues of a mesh that is divided by them (`triangle_tissue`); of another
//     one the triangles whose vertices are of different tissues stay as they are.
// These do not guarantee the bound. It is therefore verified afterwards in both directions, over the
// whole surfaces (surface_distance.h) and with the vertices in single precision as written; so is
// the absence of self-intersections. Where verification fails the tolerance is reduced locally and
// the decimation repeated, at most eight times; after that, or if the given mesh has an edge of zero
// length, the given mesh is returned.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

constexpr double kLeastMaxErrorMm = 0.001, kGreatestMaxErrorMm = 1;

struct Decimation {
  TriangleMesh mesh;  // closed and 2-manifold as the given one is, with as many parts
  // Edges of the mesh: the given feature lines, without those that are borders of tissues
  // (tissue_borders()).
  std::vector<std::array<std::uint32_t, 2>> lines;
  bool decimated = false;  // false: nothing met the bound, `mesh` is the given one
  // Greatest distance found from either surface to the other (at the vertices of both, and at points
  // between them); nowhere is it above `max_error_mm`.
  double greatest_mm = 0;
  double greatest_of_lines_mm = 0;  // of the feature lines and borders of tissues, exact
};

// mesh: closed and 2-manifold; lines: edges of it that are sharp features. Both surfaces are within
// max_error_mm of one another everywhere, and so are the lines; parts stay apart parts, and no
// triangles intersect unless those of the given mesh do. The same bits for any number of threads.
// Throws Error for a bound outside of the limits above, or a mesh that is not closed and 2-manifold.
[[nodiscard]] Decimation decimate(const TriangleMesh& mesh,
                                  const std::vector<std::array<std::uint32_t, 2>>& lines,
                                  double max_error_mm);

}  // namespace toothprep
