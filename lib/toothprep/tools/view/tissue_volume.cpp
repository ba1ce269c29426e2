#include "toothprep/tools/view/tissue_volume.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace toothprep {
namespace {

constexpr std::size_t kMost = 4'000'000;  // samples of four bytes

std::size_t number(const Index3& counts) {
  return static_cast<std::size_t>(counts.x()) * counts.y() * counts.z();
}

char depth_byte(double inside, double band) {  // inside: mm, of a level set within the band
  const double share = std::clamp(0.5 + 0.5 * inside / band, 0.0, 1.0);
  return static_cast<char>(static_cast<unsigned char>(std::lround(255 * share)));
}

}  // namespace

TissueVolume tissue_volume(const LayeredTooth& tooth) {
  const Index3 first = tooth.solid.first_brick() * kBrickEdge;
  const Index3 voxels = tooth.solid.brick_counts() * kBrickEdge;
  TissueVolume volume;
  int step = 1;
  do volume.counts = (voxels + Index3::Constant(step - 1)) / step;
  while (number(volume.counts) > kMost && ++step);
  volume.origin = tooth.lattice.to_world(first);
  volume.spacing = step * tooth.lattice.voxel;
  volume.samples.assign(kTissueCount * number(volume.counts), '\0');
  tbb::parallel_for(0, volume.counts.z(), [&](int z) {
    std::size_t at = kTissueCount * (static_cast<std::size_t>(z) * volume.counts.y() *
                                     static_cast<std::size_t>(volume.counts.x()));
    for (int y = 0; y < volume.counts.y(); ++y)
      for (int x = 0; x < volume.counts.x(); ++x) {
        const Index3 v = first + step * Index3(x, y, z);
        for (const PackedLevelSet& remains : tooth.remains)
          volume.samples[at++] = depth_byte(-remains.value(v.x(), v.y(), v.z()), tooth.band());
        const bool other = static_cast<Tissue>(tooth.tissue.value(v.x(), v.y(), v.z())) ==
                           Tissue::kOther;  // which has no level set
        volume.samples[at++] = depth_byte(other ? tooth.band() : -tooth.band(), tooth.band());
      }
  });
  return volume;
}

}  // namespace toothprep
