#include "toothprep/tools/models/tissue_triangles.h"

#include <algorithm>

namespace toothprep {

Tissue tissue_of(const TriangleMesh& mesh, std::size_t triangle) {
  if (!mesh.triangle_tissue.empty())
    return static_cast<Tissue>(std::min<int>(mesh.triangle_tissue[triangle], kTissueCount));
  if (mesh.tissue.empty()) return Tissue::kAir;
  const auto& corner = mesh.triangles[triangle];
  const std::uint8_t a = mesh.tissue[corner[0]], b = mesh.tissue[corner[1]],
                     c = mesh.tissue[corner[2]];
  return static_cast<Tissue>(std::min<int>(b == c ? b : a, kTissueCount));
}

std::vector<TissueTriangles> triangles_by_tissue(const TriangleMesh& mesh) {
  std::vector<TissueTriangles> all(kTissueCount + 1);
  for (int k = 0; k <= kTissueCount; ++k) all[k].tissue = static_cast<Tissue>(k);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    all[static_cast<std::size_t>(tissue_of(mesh, t))].triangles.push_back(mesh.triangles[t]);
  all.erase(std::remove_if(all.begin(), all.end(),
                           [](const TissueTriangles& part) { return part.triangles.empty(); }),
            all.end());
  return all;
}

std::string_view material_name(Tissue tissue) {
  return tissue == Tissue::kAir ? "surface" : kTissueNames[tissue_index(tissue)];
}

}  // namespace toothprep
