// A surface whose triangles are divided where one tissue ends and the next begins, so that each lies
// in one tissue and the borders are lines of its edges.
//
// A vertex near a border gets its tissue from tissue_distances(); an edge between two tissues gets a
// vertex where both are equally far. The surface itself stays where it was: new vertices lie on
// edges, or in a triangle where three tissues meet, but for the rounding to single precision. It
// stays closed and 2-manifold. An edge is divided no nearer to its ends than 2 % of it, and the
// ends of one that is shorter than 0.02 voxels count as of one tissue.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "toothprep/step/core/tissue.h"
#include "toothprep/tools/mesh/sharp_surface.h"

namespace toothprep {

// Divides the surface of all that remains of `tooth`, sets `triangle_tissue`, and keeps margin and
// creases as lines of edges.
void divide_by_tissue(SharpSurface& surface, const LayeredTooth& tooth);

// The surface of what remains, as sharp as the tooth allows (sharpest_surface()), divided.
[[nodiscard]] SharpSurface surface_by_tissue(const LayeredTooth& tooth);

struct TissueBorder {                               // between two tissues
  std::array<Tissue, 2> between;                    // the lower label first
  std::vector<std::array<std::uint32_t, 2>> edges;  // of the mesh, ascending
};

// Of a mesh with `triangle_tissue`: by pair, those that occur.
[[nodiscard]] std::vector<TissueBorder> tissue_borders(const TriangleMesh& mesh);

}  // namespace toothprep
