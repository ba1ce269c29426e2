#include "toothprep/tools/compare/voxel_shape.h"

#include <algorithm>
#include <cmath>

namespace toothprep {
namespace {

constexpr double kEven = 0.02;   // voxels: a second difference below counts as none
constexpr double kApart = 0.05;  // voxels: a tangent that is nearer at the centre is no other plane
constexpr double kSlope = 0.03;  // a tangent's slope is one within this

template <class Grid>
double value(const Grid& phi, const Index3& i) {
  return phi.value(i.x(), i.y(), i.z());
}

template <class Grid>
VoxelPlane central_differences(const Grid& phi, const Index3& i) {
  VoxelPlane plane{value(phi, i), Vec3::Zero()};
  for (int axis = 0; axis < 3; ++axis) {
    const Index3 step = Index3::Unit(axis);
    plane.slope[axis] = (value(phi, i + step) - value(phi, i - step)) / 2;
  }
  return plane;
}

bool even(const LevelSet& phi, const Index3& i, double voxel) {
  const double centre = value(phi, i);
  for (int axis = 0; axis < 3; ++axis) {
    const Index3 step = Index3::Unit(axis);
    if (std::abs(value(phi, i + step) + value(phi, i - step) - 2 * centre) > kEven * voxel)
      return false;
  }
  return true;
}

}  // namespace

Vec3 subcube(int n) {
  const Index3 place(n % kSubcubes, n / kSubcubes % kSubcubes, n / (kSubcubes * kSubcubes));
  return (place.cast<double>().array() + 0.5) / kSubcubes - 0.5;
}

VoxelPlane plane_of(const LevelSet& phi, const Index3& i) { return central_differences(phi, i); }

VoxelPlane plane_of(const PackedLevelSet& phi, const Index3& i) {
  return central_differences(phi, i);
}

VoxelShape::VoxelShape(const LevelSet& phi, const Index3& i, double voxel) {
  planes_[0] = plane_of(phi, i);
  if (std::abs(planes_[0].centre) > voxel || even(phi, i, voxel)) return;
  const auto is_tangent = [voxel](const VoxelPlane& plane) {
    return std::abs(plane.slope.norm() / voxel - 1) < kSlope;
  };
  double least = 0, most = 0;  // of tangents at the centre, above the level set
  std::size_t count = is_tangent(planes_[0]) ? 1 : 0;
  for (int n = 0; n < 27; ++n) {
    const Index3 step(2 * (n % 3 - 1), 2 * (n / 3 % 3 - 1), 2 * (n / 9 - 1));
    if (step == Index3::Zero()) continue;
    VoxelPlane plane = plane_of(phi, i + step);
    if (!is_tangent(plane)) continue;
    plane.centre -= plane.slope.dot(step.cast<double>());
    const double above = plane.centre - value(phi, i);
    least = std::min(least, above);
    most = std::max(most, above);
    planes_[count++] = plane;
  }
  const double apart = kApart * voxel;
  if (count < 2 || (most > apart) == (least < -apart)) {  // even after all, or a saddle
    planes_[0] = plane_of(phi, i);
    return;
  }
  count_ = count;
  convex_ = least < -apart;
}

const VoxelPlane& VoxelShape::plane_at(const Vec3& from_centre) const {
  std::size_t best = 0;
  double bound = planes_[0].at(from_centre);
  for (std::size_t k = 1; k < count_; ++k) {
    const double here = planes_[k].at(from_centre);
    if (convex_ ? here <= bound : here >= bound) continue;
    best = k;
    bound = here;
  }
  return planes_[best];
}

double VoxelShape::share(double voxel) const {
  const double cube = voxel / kSubcubes;
  constexpr int kAll = kSubcubes * kSubcubes * kSubcubes;
  double sum = 0;
  for (int n = 0; n < kAll; ++n) {
    const Vec3 at = subcube(n);
    sum += std::clamp(0.5 - plane_at(at).at(at) / cube, 0.0, 1.0);
  }
  return sum / kAll;
}

}  // namespace toothprep
