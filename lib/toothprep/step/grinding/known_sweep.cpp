#include "toothprep/step/grinding/known_sweep.h"

namespace toothprep {

bool KnownSweep::is_of(const StraightSweep& other) const noexcept {
  return other.way == sweep.way && other.from.position == sweep.from.position &&
         other.from.orientation.coeffs() == sweep.from.orientation.coeffs();
}

bool KnownSweep::set(const Bur& bur, const StraightSweep& of) noexcept {
  if (is_of(of)) return length > 0;
  sweep = of;
  const double way = of.way.norm();
  length = 0;
  if (!(way > 0)) return false;
  if (!outline.draw(bur.profile(), of.from.orientation.conjugate() * of.way / way)) return false;
  length = static_cast<float>(way);
  return true;
}

void KnownSweep::put(const Lattice& lattice, const Index3& base) noexcept {
  const SweptOutline::Axes& axes = outline.axes();
  const auto put_one = [&](const Vec3& axis, float(&to)[4]) {
    const Vec3 in_world = sweep.from.orientation * axis;
    for (int i = 0; i < 3; ++i) to[i] = static_cast<float>(lattice.voxel * in_world[i]);
    to[3] = static_cast<float>(in_world.dot(lattice.to_world(base) - sweep.from.position));
  };
  margin = static_cast<float>(lattice.voxel);
  put_one(axes.beside, l), put_one(axes.up, h), put_one(axes.along, t);
}

}  // namespace toothprep
