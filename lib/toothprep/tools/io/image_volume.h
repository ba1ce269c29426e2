// A dense 3-D image with its place in the world, free of any image library. x varies fastest.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "toothprep/step/core/geometry.h"

namespace toothprep {

// Where an image lies, without its values.
struct ImageFrame {
  Index3 size = Index3::Zero();       // voxels
  Vec3 spacing = Vec3::Ones();        // mm
  Vec3 origin = Vec3::Zero();         // mm, W: the centre of voxel (0, 0, 0)
  Mat3 direction = Mat3::Identity();  // columns: the image axes in W (LPS)
  // A place in voxels to W, mm; the matrix that takes x - origin back; how many voxels there are.
  [[nodiscard]] Vec3 to_world(const Vec3& index) const {
    return origin + direction * spacing.cwiseProduct(index);
  }
  Mat3 to_index() const { return spacing.cwiseInverse().asDiagonal() * direction.transpose(); }
  std::size_t voxels() const { return static_cast<std::size_t>(size.cast<double>().prod()); }
};

template <class T>
struct ImageVolume : ImageFrame {  // an image with its values
  std::vector<T> data;             // voxels() values

  [[nodiscard]] std::size_t offset(int i, int j, int k) const {  // x fastest
    return (static_cast<std::size_t>(k) * size.y() + j) * size.x() + i;
  }
  T& at(int i, int j, int k) { return data[offset(i, j, k)]; }              // unchecked
  const T& at(int i, int j, int k) const { return data[offset(i, j, k)]; }  // unchecked
};

}  // namespace toothprep
