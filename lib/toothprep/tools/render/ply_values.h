// What a .ply says about its vertices besides where they are: read_shell() keeps only the shape.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

// The scalar property `name` (`tissue`, `quality`, ...) of a .ply, for
// the vertices of `mesh`, which must be what read_shell() made of the same file (vertices at the
// same place are one: the first counts). Nothing if the file can't be read, isn't a .ply or has no such property.
std::optional<std::vector<float>> vertex_property(const std::string& path, const TriangleMesh& mesh,
                                                  const std::string& name);

// The scalar property `name` of the faces of a .ply, for triangles that were made of its faces
// (Shell::face, counted from 1). Nothing as above.
std::optional<std::vector<float>> triangle_property(const std::string& path,
                                                    const std::vector<std::uint32_t>& face_of,
                                                    const std::string& name);

}  // namespace toothprep
