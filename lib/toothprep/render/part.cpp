#include "toothprep/render/part.h"

#include <cmath>

#include "toothprep/core/errors.h"

namespace toothprep {

RenderPart part_of(const LayeredTooth& tooth) {
  RenderPart part;
  part.mesh = extract_surface(tooth, SurfaceOf::kAll);
  if (part.mesh.triangles.empty()) throw Error("nothing remains of the tooth");
  part.tooth = &tooth;
  return part;
}

double level_at(const LevelSet& level_set, const Lattice& lattice, const Vec3& x) {
  const Vec3 at = lattice.to_index(x);
  const Vec3 low(std::floor(at.x()), std::floor(at.y()), std::floor(at.z()));
  const Index3 i = low.cast<int>();
  const Vec3 t = at - low;
  double sum = 0;
  for (int c = 0; c < 8; ++c)
    sum += (c & 1 ? t.x() : 1 - t.x()) * (c & 2 ? t.y() : 1 - t.y()) * (c & 4 ? t.z() : 1 - t.z()) *
           level_set.value(i.x() + (c & 1), i.y() + (c >> 1 & 1), i.z() + (c >> 2));
  return sum;
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
