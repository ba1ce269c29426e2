// Whether two triangles of a mesh pass through one another: for a few about a vertex, in double
// precision. For whole meshes CGAL decides exactly (intersecting_triangles in tools/decimation); it
// would bring -frounding-math to this module.
#pragma once

#include <cstdint>

#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

// Of two different triangles, by their indices: whether they have more in common than corners and
// edges, within 1 nm.
[[nodiscard]] bool cross(const TriangleMesh& mesh, std::size_t a, std::size_t b);

}  // namespace toothprep
