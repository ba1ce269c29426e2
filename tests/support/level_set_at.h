// Level sets between their voxels.
#pragma once

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// Trilinear of a level set, mm.
template <class Grid>
double at(const Grid& level_set, const Lattice& lattice, const Vec3& x) {
  const Vec3 index = lattice.to_index(x), low = index.array().floor();
  const Index3 i = low.cast<int>();
  const Vec3 f = index - low;
  double sum = 0;
  for (int c = 0; c < 8; ++c) {
    const Index3 n(c & 1, (c >> 1) & 1, c >> 2);
    double w = 1;
    for (int a = 0; a < 3; ++a) w *= n[a] ? f[a] : 1 - f[a];
    sum += w * level_set.value(i.x() + n.x(), i.y() + n.y(), i.z() + n.z());
  }
  return sum;
}

// How much enamel there is on the way inwards from a place of the true surface.
inline double enamel_below(const LayeredTooth& tooth, const Vec3& place, const Vec3& inwards) {
  constexpr double kStep = 0.01;
  double length = 0;
  for (double s = -0.2; s < 1; s += kStep)
    if (at(tooth.remains[0], tooth.lattice, place + s * inwards) < 0) length += kStep;
  return length;
}

}  // namespace toothprep
