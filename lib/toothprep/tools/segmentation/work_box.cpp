#include "toothprep/tools/segmentation/work_box.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/memory_limit.h"

namespace toothprep {
namespace {

// At the peak of the work, with a reserve (grey scans take 12); the time on two cores of 2.3 GHz. Then those of a voxel
// of the tooth alone, whose surfaces were found in larger ones (grey scans take 3).
constexpr double kBytesPerVoxel = 50, kSecondsPerVoxel = 4e-7;
constexpr double kBytesOfTooth = 8, kSecondsOfTooth = 4e-8;

}  // namespace

std::string short_number(double value) { return fmt::format("{:.4g}", value); }

WorkBox box_around(const ImageFrame& image, const Vec3& index_min, const Vec3& index_max,
                   double voxel, int margin, const Announce& announce, double work_voxel) {
  if (!(voxel > 0 && voxel <= 10))
    throw Error("voxel size must lie in (0, 10] mm, got " + short_number(voxel));
  Vec3 low = Vec3::Constant(1e300), high = Vec3::Constant(-1e300);
  for (int c = 0; c < 8; ++c) {
    const Vec3 corner((c & 1) ? index_max.x() + 0.5 : index_min.x() - 0.5,
                      (c & 2) ? index_max.y() + 0.5 : index_min.y() - 0.5,
                      (c & 4) ? index_max.z() + 0.5 : index_min.z() - 0.5);
    low = low.cwiseMin(image.to_world(corner));
    high = high.cwiseMax(image.to_world(corner));
  }
  const Vec3 extent = high - low;
  const Vec3 count = extent / voxel + Vec3::Constant(2.0 * margin + 2);
  constexpr double kLargestTooth = 60;  // mm
  if (!(low / voxel).allFinite() || (low / voxel).cwiseAbs().maxCoeff() > 1e8)
    throw Error("the tooth lies " + short_number(low.cwiseAbs().maxCoeff()) +
                " mm from the frame's zero, too far for voxels of " + short_number(voxel) + " mm");
  const bool finer = work_voxel > voxel;
  const double worked = finer ? std::pow(voxel / work_voxel, 3) : 1;  // voxels per voxel
  try {
    const std::string work =
        announced_voxels(count.prod(), voxel, worked * kBytesPerVoxel + (finer ? kBytesOfTooth : 0),
                         worked * kSecondsPerVoxel + (finer ? kSecondsOfTooth : 0));
    if (announce && !work.empty()) announce(work);
  } catch (const Error& e) {
    throw Error("the tooth's box of " + short_number(extent.x()) + " x " +
                short_number(extent.y()) + " x " + short_number(extent.z()) +
                " mm is too large: " + e.what() +
                (extent.maxCoeff() > kLargestTooth
                     ? "; it is no tooth's size: give the scan's own voxel size with --spacing-mm"
                     : ""));
  }
  WorkBox box;
  box.lattice.voxel = voxel;
  box.lattice.origin = Vec3::Constant(0.5 * voxel);
  for (int a = 0; a < 3; ++a) {
    box.lower[a] = static_cast<int>(std::floor(low[a] / voxel - 0.5)) - margin;
    box.size[a] = static_cast<int>(std::ceil(high[a] / voxel - 0.5)) + margin - box.lower[a] + 1;
  }
  return box;
}

}  // namespace toothprep
