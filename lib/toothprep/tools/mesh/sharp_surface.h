// The surface of a prepared tooth with a sharp margin: where the cut meets the tooth's own surface,
// both are kept up to the curve in which they intersect.
//
//   inside = { f < 0 and g < 0 },   f = intact, g = -cut   (ToothParts)
//
// A cell in which both fields have a zero is divided into six tetrahedra (Kuhn's, which match from
// cell to cell). In one, both fields are taken as linear, so that inside is a convex polytope and
// its surface the polygon of f = 0 clipped by g < 0 and that of g = 0 clipped by f < 0. Both end on
// the same segment, which is the margin. In all other cells the surface is that of one field, made
// as extract_surface() does it; of those that share a face with a divided cell, by pyramids over
// the six faces, whose apex is the cell's middle and whose base is cut as the neighbour cuts it. A
// vertex belongs to an edge (where one field is zero) or to a face (where both are) of these
// pieces, so neighbours share it: the surface closes and is 2-manifold, also where a wall is
// thinner than a voxel. Which of two crossings of an edge comes first is decided exactly, ties by a
// symbolic shift of g.
//
// Error near the margin: that of linear interpolation over a tetrahedron, at most 3/8 D² times the
// curvature of a field (D the voxel) and about a third of it on average; along the margin divided
// by the sine of the angle between both surfaces.
//
// Line angles of the cut (where a cavity's floor meets its wall, or two passes left a ridge) are
// sharp too: creases.h finds the faces in the cut's samples, and crease_division.h divides the
// edges and triangles that reach from one face to the next, also on the margin.
// Creases of the tooth itself are bevelled within a voxel, as in extract_surface().
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

struct SharpSurface {  // a closed surface and its sharp edges
  TriangleMesh mesh;   // as extract_surface() gives it
  // The margin: edges of the mesh between the tooth's own surface and the cut's.
  std::vector<std::array<std::uint32_t, 2>> margin;
  // The cut's line angles: edges of the mesh.
  std::vector<std::array<std::uint32_t, 2>> creases;
};

// Of what remains of the whole tooth. Throws Error if the tooth has no parts.
[[nodiscard]] SharpSurface extract_sharp_surface(const LayeredTooth& tooth);

// The surface of what remains as sharp as the tooth allows: that of extract_sharp_surface() if it
// has parts, else extract_surface().
[[nodiscard]] TriangleMesh sharpest_surface(const LayeredTooth& tooth);

}  // namespace toothprep
