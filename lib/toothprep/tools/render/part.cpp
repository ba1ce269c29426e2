#include "toothprep/tools/render/part.h"

#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/tooth/level_at.h"

namespace toothprep {

RenderPart part_of(const LayeredTooth& tooth) {
  RenderPart part;
  part.mesh = extract_surface(tooth, SurfaceOf::kAll);
  if (part.mesh.triangles.empty()) throw Error("nothing remains of the tooth");
  part.tooth = &tooth;
  return part;
}

Vec3 level_normal(const LayeredTooth& tooth, const Vec3& x) {
  const double reach = tooth.lattice.voxel;
  Vec3 gradient;
  for (int k = 0; k < 3; ++k)
    gradient[k] = level_at(tooth.solid, tooth.lattice, x + reach * Vec3::Unit(k)) -
                  level_at(tooth.solid, tooth.lattice, x - reach * Vec3::Unit(k));
  // A distance has the slope one: 2 voxels. Much less, and two surfaces stand too close here.
  if (gradient.norm() < 0.6 * reach) return Vec3::Zero();
  return gradient.normalized();
}

Tissue tissue_in(const LayeredTooth& tooth, const Vec3& x) {
  int best = -1;
  double least = tooth.lattice.voxel / 2;
  for (int k = 0; k < 3; ++k) {
    const double phi = level_at(tooth.remains[k], tooth.lattice, x);
    if (phi >= least) continue;
    least = phi;
    best = k;
  }
  if (best >= 0) return tissue_at(best);
  const Vec3 at = tooth.lattice.to_index(x);
  const auto label = tooth.tissue.value(static_cast<int>(std::lround(at.x())),
                                        static_cast<int>(std::lround(at.y())),
                                        static_cast<int>(std::lround(at.z())));
  return label == 0 ? Tissue::kOther : static_cast<Tissue>(label);
}

}  // namespace toothprep
