// Divides a surface along the line angles of a cut, so that these are lines of edges.
//
// A surface that is interpolated between samples bevels a line angle: its triangles reach from one
// face of the cut to the next. Here each edge between two faces gets a vertex where the faces
// intersect, and a triangle between three of them one in their corner. On the margin, which is an
// edge of the tooth's surface and the cut's, the vertex is where both faces meet the tooth. Vertices
// of the cut near a crease are moved to the faces first, along the ways on which the surface was
// found. The surface stays closed and 2-manifold, since edges and triangles are only divided.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "toothprep/tools/mesh/sharp_surface.h"
#include "toothprep/tools/mesh/two_fields.h"

namespace toothprep {

// Sets `creases`. `on_cut`: per triangle, whether it is of the cut's field. `way`: the ends, in
// voxels, of the way on which a vertex of the cut that isn't on the margin was found.
void divide_at_creases(SharpSurface& surface, const LayeredTooth& tooth, const Fields& fields,
                       std::vector<bool> on_cut,
                       const std::function<std::array<Vec3, 2>(std::uint32_t)>& way);

}  // namespace toothprep
