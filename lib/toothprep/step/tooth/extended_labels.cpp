#include "toothprep/step/tooth/extended_labels.h"

#include <algorithm>
#include <vector>

namespace toothprep {
namespace {

LabelGrid with_another_layer(const LabelGrid& labels, const LevelSet& solid, float reach) {
  static const std::vector<Index3> neighbours = [] {
    std::vector<Index3> n;
    for (int x = -1; x <= 1; ++x)
      for (int y = -1; y <= 1; ++y)
        for (int z = -1; z <= 1; ++z)
          if (x || y || z) n.emplace_back(x, y, z);
    std::stable_sort(n.begin(), n.end(), [](const Index3& a, const Index3& b) {
      return a.squaredNorm() < b.squaredNorm();
    });
    return n;
  }();
  LabelGrid extended = labels;
  for (std::size_t b = 0; b < labels.table_size(); ++b) {
    if (solid.is_uniform(b)) continue;  // no surface within the band
    const std::uint8_t* here = labels.brick(b);
    const float* phi = solid.brick(b);
    const Index3 first = labels.brick_origin(b);
    std::uint8_t* target = nullptr;
    for (int v = 0; v < kBrickVoxels; ++v) {
      if (here[v] != 0 || phi[v] > reach) continue;
      const Index3 at = first + Index3(v >> 6, (v >> 3) & 7, v & 7);
      for (const Index3& n : neighbours) {
        const std::uint8_t label = labels.value(at.x() + n.x(), at.y() + n.y(), at.z() + n.z());
        if (label == 0) continue;
        if (!target) target = extended.writable_brick(b);
        target[v] = label;
        break;
      }
    }
  }
  return extended;
}

}  // namespace

LabelGrid extended_labels(const LabelGrid& labels, const LevelSet& solid, float reach, int layers) {
  LabelGrid extended = labels;
  for (int layer = 0; layer < layers; ++layer)
    extended = with_another_layer(extended, solid, reach);
  return extended;
}

}  // namespace toothprep
