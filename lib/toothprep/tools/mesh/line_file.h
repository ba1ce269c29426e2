// Lines of a mesh's edges (margins, line angles, borders of tissues) as a file of polylines.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "toothprep/tools/mesh/tissue_division.h"

namespace toothprep {

// Edges that are one kind of line.
struct NamedLines {
  std::string name;                                 // a word
  std::vector<std::array<std::uint32_t, 2>> edges;  // of a mesh
};

// Those that a surface has: `margin`, `line_angles`, and a border `enamel_dentin`, ... for each pair
// of tissues that meet on it.
[[nodiscard]] std::vector<NamedLines> lines_of(const SharpSurface& surface);

// Edges as polylines through all of them, each once: from every place where lines end or more than
// two meet to the next, then closed ones, whose last vertex is the first.
[[nodiscard]] std::vector<std::vector<std::uint32_t>> polylines_of(
    const std::vector<std::array<std::uint32_t, 2>>& edges);

// As .obj: a group for each name that has edges, `l` for each polyline; coordinates in mm, those of
// the mesh. Throws Error if there are no edges at all. Writes `path` itself.
void write_lines(const TriangleMesh& mesh, const std::vector<NamedLines>& lines,
                 const std::string& path);

}  // namespace toothprep
