#include "toothprep/tools/render/part.h"

#include "toothprep/step/core/errors.h"
#include "toothprep/step/tooth/level_at.h"
#include "toothprep/tools/mesh/tissue_division.h"
#include "toothprep/tools/mesh/tissue_levels.h"

namespace toothprep {

RenderPart part_of(const LayeredTooth& tooth) {
  RenderPart part;
  part.mesh = surface_by_tissue(tooth).mesh;
  if (part.mesh.triangles.empty()) throw Error("nothing remains of the tooth");
  part.tooth = &tooth;
  return part;
}

Side side_at(const LayeredTooth& tooth, const Vec3& x) {
  if (!tooth.parts) return Side::kSolid;
  const ToothParts& parts = *tooth.parts;
  return -level_at(parts.cut, tooth.lattice, x) > level_at(parts.intact, tooth.lattice, x)
             ? Side::kCut
             : Side::kIntact;
}

Vec3 level_normal(const LayeredTooth& tooth, const Vec3& x, Side side) {
  const LevelSet& level = side == Side::kSolid    ? tooth.solid
                          : side == Side::kIntact ? tooth.parts->intact
                                                  : tooth.parts->cut;
  const double reach = tooth.lattice.voxel, sign = side == Side::kCut ? -1 : 1;
  Vec3 gradient;
  for (int k = 0; k < 3; ++k)
    gradient[k] = sign * (level_at(level, tooth.lattice, x + reach * Vec3::Unit(k)) -
                          level_at(level, tooth.lattice, x - reach * Vec3::Unit(k)));
  // A distance has the slope one: 2 voxels. Much less, and two surfaces stand too close here.
  if (gradient.norm() < 0.6 * reach) return Vec3::Zero();
  return gradient.normalized();
}

bool inside(const LayeredTooth& tooth, const Vec3& x) {
  if (!tooth.parts) return level_at(tooth.solid, tooth.lattice, x) < 0;
  return level_at(tooth.parts->intact, tooth.lattice, x) < 0 &&
         level_at(tooth.parts->cut, tooth.lattice, x) > 0;
}

Tissue tissue_in(const LayeredTooth& tooth, const Vec3& x) {
  return tissue_near(tooth, tooth.lattice.to_index(x));
}

}  // namespace toothprep
