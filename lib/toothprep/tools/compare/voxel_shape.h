// A level set within a voxel as planes: one where it is even, several where two or more of its
// surfaces meet in or beside the voxel (a line angle, the edge of a margin).
//
// The volume fraction of a voxel below one plane is 0.5 - phi/D to a good mean; at an edge that takes
// min(a, b) of both planes' fractions for a b, which is 1/12 D² too much per length of a right
// angle. So the planes of the neighbourhood are looked for. Where the level set is a maximum of
// planes, a convex function, every tangent is a lower bound of it and the largest of them is the
// level set; where it is a minimum, the other way round. Tangents come from voxels two steps away,
// and only those count whose slope is one: the others straddle the edge.
#pragma once

#include <array>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

struct VoxelPlane {
  double centre = 0;          // mm, at the voxel's centre
  Vec3 slope = Vec3::Zero();  // mm per voxel
  double at(const Vec3& from_centre) const { return centre + slope.dot(from_centre); }  // voxels
};

// By central differences.
VoxelPlane plane_of(const LevelSet& phi, const Index3& i);
VoxelPlane plane_of(const PackedLevelSet& phi, const Index3& i);

class VoxelShape {
 public:
  VoxelShape(const LevelSet& phi, const Index3& i, double voxel);
  bool has_edge() const { return count_ > 1; }
  // The plane that the level set follows there.
  const VoxelPlane& plane_at(const Vec3& from_centre) const;
  // The voxel's volume fraction below zero, by subcubes.
  double share(double voxel) const;

 private:
  std::array<VoxelPlane, 27> planes_;
  std::size_t count_ = 1;
  bool convex_ = false;
};

// Subcubes of a voxel per edge, and the place of one, in voxels from the centre.
inline constexpr int kSubcubes = 4;
Vec3 subcube(int n);

}  // namespace toothprep
