// A mesh's triangles by tissue.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

#include "toothprep/step/core/tissue.h"
#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

// The triangle's own; of a mesh whose triangles have none, of the three labels the one that most
// vertices have, the first if all differ. Air where the mesh has no tissues.
[[nodiscard]] Tissue tissue_of(const TriangleMesh& mesh, std::size_t triangle);

struct TissueTriangles {
  Tissue tissue = Tissue::kAir;
  std::vector<std::array<std::uint32_t, 3>> triangles;  // in the mesh's order
};

// Those that occur, by label.
[[nodiscard]] std::vector<TissueTriangles> triangles_by_tissue(const TriangleMesh& mesh);

// "enamel", ...; "surface" for air, of a mesh without tissues.
[[nodiscard]] std::string_view material_name(Tissue tissue);

}  // namespace toothprep
