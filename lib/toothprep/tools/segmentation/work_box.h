// The dense box of voxels that voxelizing works on.
#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/io/image_volume.h"
#include "toothprep/tools/segmentation/band_field.h"

namespace toothprep {

using Field = std::vector<float>;  // one value per voxel of a WorkBox, x fastest

struct WorkBox {
  Lattice lattice;
  Index3 lower = Index3::Zero();  // lattice index of the box's first voxel
  Index3 size = Index3::Zero();

  std::size_t voxels() const { return static_cast<std::size_t>(size.cast<double>().prod()); }
  std::size_t offset(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * size.y() + j) * size.x() + i;
  }
  Vec3 centre(const Index3& i) const { return lattice.to_world(lower + i); }  // mm, W

  // work(i, j, k, offset) for every voxel, planes in parallel.
  template <class Work>
  void for_each(const Work& work) const {
    tbb::parallel_for(0, size.z(), [&](int k) {
      std::size_t v = offset(0, 0, k);
      for (int j = 0; j < size.y(); ++j)
        for (int i = 0; i < size.x(); ++i, ++v) work(i, j, k, v);
    });
  }
  // work(j, k, first, end) for every row along x, planes in parallel.
  template <class Work>
  void for_each_row(const Work& work) const {
    tbb::parallel_for(0, size.z(), [&](int k) {
      for (int j = 0; j < size.y(); ++j) work(j, k, offset(0, j, k), offset(0, j + 1, k));
    });
  }
};

// The least of single precision that is not below a number: what is at least one is at least the other.
inline float not_below(double value) {
  const auto nearest = static_cast<float>(value);
  return nearest >= value ? nearest
                          : std::nextafter(nearest, std::numeric_limits<float>::infinity());
}

// work(i, j, k, offset) for every voxel that the field has, planes in parallel.
template <class Work>
void for_each_of(const WorkBox& box, const BandField& field, const Work& work) {
  tbb::parallel_for(0, box.size.z(), [&](int k) {
    for (int j = 0; j < box.size.y(); ++j) {
      const std::size_t row = box.offset(0, j, k);
      field.for_each(row, row + static_cast<std::size_t>(box.size.x()),
                     [&](std::size_t v) { work(static_cast<int>(v - row), j, k, v); });
    }
  });
}

// The box around the image's voxels index_min .. index_max (inclusive) and `margin` output voxels.
// Its lattice's voxels lie side by side from the frame's zero: faces are multiples of `voxel`. Tells
// `announce` what the box will take if that is much, where surfaces are sought in voxels of `work_voxel` mm if those
// are larger. Throws Error if the voxel size is out of range, or if the box would hold more than 2^29 voxels or take
// more memory than there is.
using Announce = std::function<void(const std::string&)>;
WorkBox box_around(const ImageFrame& image, const Vec3& index_min, const Vec3& index_max,
                   double voxel, int margin, const Announce& announce = {}, double work_voxel = 0);

// Calls sample(offset, centre, points) for every output voxel, planes in parallel: n^3 points
// spread evenly over the voxel, relative to its centre, both in (fractional) voxels of the image.
template <class Sample>
void for_each_point_set(const ImageFrame& image, const WorkBox& box, int n, const Sample& sample) {
  const Mat3 to_index = image.to_index();
  std::vector<Vec3> points;
  for (int c = 0; c < n * n * n; ++c)
    points.push_back(
        to_index *
        (Index3(c % n, c / n % n, c / (n * n)).cast<double>() - Vec3::Constant(0.5 * (n - 1))) *
        (box.lattice.voxel / n));
  box.for_each([&](int i, int j, int k, std::size_t v) {
    sample(v, Vec3(to_index * (box.centre(Index3(i, j, k)) - image.origin)), points);
  });
}

// Value at a fractional voxel, linear between the values of an array (or a TrimmedField), whose edge
// values are continued outside.
template <class Values>
float trilinear(const Index3& size, const Values& values, const Vec3& index) {
  Index3 base;
  Vec3 f;
  for (int a = 0; a < 3; ++a) {
    const double x = std::clamp(index[a], 0.0, size[a] - 1.0);
    base[a] = std::min(static_cast<int>(x), size[a] - 2);
    f[a] = x - base[a];
  }
  const auto row = static_cast<std::size_t>(size.x()),
             plane = row * static_cast<std::size_t>(size.y());
  const std::size_t v = static_cast<std::size_t>(base.z()) * plane +
                        static_cast<std::size_t>(base.y()) * row +
                        static_cast<std::size_t>(base.x());
  const auto along_x = [&](std::size_t o) {
    const float low = values[v + o];
    return low + f.x() * (values[v + o + 1] - low);
  };
  const double a = along_x(0), b = along_x(row), c = along_x(plane), d = along_x(plane + row);
  const double ab = a + f.y() * (b - a), cd = c + f.y() * (d - c);
  return static_cast<float>(ab + f.z() * (cd - ab));
}

std::string short_number(double value);  // four digits

}  // namespace toothprep
