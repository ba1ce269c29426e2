// A part of a scan: what is left of it is treated as a scan of its own.
#pragma once

#include <algorithm>
#include <cmath>
#include <string>

#include "toothprep/core/errors.h"
#include "toothprep/core/image_volume.h"
#include "toothprep/tooth/layered_tooth.h"

namespace toothprep {

// The voxels around a box of W (LPS, mm): of an oblique image the smallest block of its own voxels
// that holds the box. The place of each voxel stays. Throws Error if the box's corners are not in
// order or less than two voxels along an axis are left.
template <class T>
ImageVolume<T> crop(const ImageVolume<T>& image, const Box& box) {
  if (!box.min.allFinite() || !box.max.allFinite() || !(box.min.array() < box.max.array()).all())
    throw Error("region: its lower corner must lie below its upper one along every axis");
  Vec3 low = Vec3::Constant(1e300), high = Vec3::Constant(-1e300);
  for (int c = 0; c < 8; ++c) {
    const Vec3 corner(c & 1 ? box.max.x() : box.min.x(), c & 2 ? box.max.y() : box.min.y(),
                      c & 4 ? box.max.z() : box.min.z());
    const Vec3 at =
        (image.direction.transpose() * (corner - image.origin)).cwiseQuotient(image.spacing);
    low = low.cwiseMin(at);
    high = high.cwiseMax(at);
  }
  Index3 first, last;
  for (int a = 0; a < 3; ++a) {
    const double top = image.size[a] - 1.0;
    first[a] = static_cast<int>(std::clamp(std::floor(low[a]), 0.0, top));
    last[a] = static_cast<int>(std::clamp(std::ceil(high[a]), 0.0, top));
    if (last[a] - first[a] < 1)
      throw Error("region: less than two voxels of the scan lie in it along axis " +
                  std::to_string(a + 1) + "; it is given in mm, in the scan's frame (LPS)");
  }
  ImageVolume<T> part;
  const Index3 size = last - first + Index3::Ones();
  const Vec3 corner = first.cast<double>();
  part.size = size;
  part.spacing = image.spacing;
  part.direction = image.direction;
  part.origin = image.to_world(corner);
  part.data.reserve(static_cast<std::size_t>(size.x()) * size.y() * size.z());
  for (int k = first.z(); k <= last.z(); ++k)
    for (int j = first.y(); j <= last.y(); ++j)
      for (int i = first.x(); i <= last.x(); ++i) part.data.push_back(image.at(i, j, k));
  return part;
}

}  // namespace toothprep
