// Of a lattice the voxel that holds a place.
#pragma once

#include "toothprep/step/core/geometry.h"

namespace toothprep {

// floor, without a call where the processor's own isn't compiled in. `x`: of an int's range.
inline int below(double x) {
  const int cut_off = static_cast<int>(x);
  return cut_off - (x < cut_off);
}

// `corner`: the place in voxels, from the first voxel's lowest corner.
inline Index3 voxel_at(const Vec3& corner) {
  return {below(corner.x()), below(corner.y()), below(corner.z())};
}

}  // namespace toothprep
