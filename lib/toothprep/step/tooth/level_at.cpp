#include "toothprep/step/tooth/level_at.h"

namespace toothprep {
namespace {

template <class Grid>
double interpolated(const Grid& level_set, const Lattice& lattice, const Vec3& x) {
  const Vec3 at = lattice.to_index(x);
  // Far outside, where the index would not fit an int.
  if (!(at.cwiseAbs().maxCoeff() < 1e9)) return level_set.background();
  const Index3 i = at.array().floor().cast<int>();
  const Vec3 f = at - i.cast<double>();
  const auto row = [&](int dx, int dy) {
    const double a = level_set.value(i.x() + dx, i.y() + dy, i.z());
    const double b = level_set.value(i.x() + dx, i.y() + dy, i.z() + 1);
    return a + f.z() * (b - a);
  };
  const double low = row(0, 0) + f.y() * (row(0, 1) - row(0, 0));
  const double high = row(1, 0) + f.y() * (row(1, 1) - row(1, 0));
  return low + f.x() * (high - low);
}

}  // namespace

double level_at(const LevelSet& level_set, const Lattice& lattice, const Vec3& x) {
  return interpolated(level_set, lattice, x);
}

double level_at(const PackedLevelSet& level_set, const Lattice& lattice, const Vec3& x) {
  return interpolated(level_set, lattice, x);
}

}  // namespace toothprep
