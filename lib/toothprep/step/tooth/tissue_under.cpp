#include "toothprep/step/tooth/tissue_under.h"

#include <algorithm>
#include <vector>

namespace toothprep {
namespace {

// Offsets to the voxels around one, nearest first (ties in a fixed order).
std::vector<Index3> nearest_offsets(int reach) {
  std::vector<Index3> offsets;
  for (int x = -reach; x <= reach; ++x)
    for (int y = -reach; y <= reach; ++y)
      for (int z = -reach; z <= reach; ++z) offsets.emplace_back(x, y, z);
  std::stable_sort(offsets.begin(), offsets.end(), [](const Index3& a, const Index3& b) {
    return a.squaredNorm() < b.squaredNorm();
  });
  return offsets;
}

std::uint8_t label_near(const LabelGrid& labels, const Index3& voxel) {
  static const std::vector<Index3> kOffsets = nearest_offsets(2);
  for (const Index3& o : kOffsets) {
    const Index3 i = voxel + o;
    if (const std::uint8_t label = labels.value(i.x(), i.y(), i.z())) return label;
  }
  return static_cast<std::uint8_t>(Tissue::kOther);
}

}  // namespace

std::uint8_t tissue_under(const LayeredTooth& tooth, const Index3& inside, const Index3& outside,
                          double s, float remaining_inside, float remaining_outside) {
  if (tooth.tissue.value(inside.x(), inside.y(), inside.z()) !=
      static_cast<std::uint8_t>(Tissue::kOther)) {  // which has no level set of its own
    int nearest = 0;
    double least = tooth.lattice.voxel / 2;
    for (int k = 0; k < 3; ++k) {
      const double a =
          std::max(tooth.remains[k].value(inside.x(), inside.y(), inside.z()), remaining_inside);
      const double b = std::max(tooth.remains[k].value(outside.x(), outside.y(), outside.z()),
                                remaining_outside);
      const double phi = (1 - s) * a + s * b;
      if (phi < least) {
        least = phi;
        nearest = k + 1;
      }
    }
    if (nearest > 0) return static_cast<std::uint8_t>(nearest);
  }
  return label_near(tooth.tissue, inside);
}

}  // namespace toothprep
