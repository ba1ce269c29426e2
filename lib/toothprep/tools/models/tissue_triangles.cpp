#include "toothprep/tools/models/tissue_triangles.h"

#include <algorithm>

namespace toothprep {

Tissue tissue_of(const TriangleMesh& mesh, const std::array<std::uint32_t, 3>& triangle) {
  if (mesh.tissue.empty()) return Tissue::kAir;
  const std::uint8_t a = mesh.tissue[triangle[0]], b = mesh.tissue[triangle[1]],
                     c = mesh.tissue[triangle[2]];
  return static_cast<Tissue>(std::min<int>(b == c ? b : a, kTissueCount));
}

std::vector<TissueTriangles> triangles_by_tissue(const TriangleMesh& mesh) {
  std::vector<TissueTriangles> all(kTissueCount + 1);
  for (int k = 0; k <= kTissueCount; ++k) all[k].tissue = static_cast<Tissue>(k);
  for (const auto& triangle : mesh.triangles)
    all[static_cast<std::size_t>(tissue_of(mesh, triangle))].triangles.push_back(triangle);
  all.erase(std::remove_if(all.begin(), all.end(),
                           [](const TissueTriangles& part) { return part.triangles.empty(); }),
            all.end());
  return all;
}

std::string_view material_name(Tissue tissue) {
  return tissue == Tissue::kAir ? "surface" : kTissueNames[tissue_index(tissue)];
}

}  // namespace toothprep
