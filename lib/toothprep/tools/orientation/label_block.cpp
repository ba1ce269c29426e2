#include "toothprep/tools/orientation/label_block.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

namespace toothprep {
namespace {

// First and last voxel with a label, inclusive; first above last if there is none.
std::pair<Index3, Index3> labelled_box(const LabelGrid& labels) {
  Index3 low = Index3::Constant(std::numeric_limits<int>::max());
  Index3 high = Index3::Constant(std::numeric_limits<int>::min());
  for (std::size_t b = 0; b < labels.table_size(); ++b) {
    if (labels.is_uniform(b) && labels.uniform_value(b) == 0) continue;
    const std::uint8_t* voxels = labels.brick(b);
    const Index3 origin = labels.brick_origin(b);
    for (int v = 0; v < kBrickVoxels; ++v)
      if (voxels[v] != 0) {
        const Index3 at = origin + Index3(v >> 6, (v >> 3) & 7, v & 7);
        low = low.cwiseMin(at);
        high = high.cwiseMax(at);
      }
  }
  return {low, high};
}

}  // namespace

bool LabelBlock::beside(std::size_t n, Tissue tissue) const {
  const std::ptrdiff_t sx = static_cast<std::ptrdiff_t>(size.y()) * size.z(), sy = size.z();
  const auto wanted = static_cast<std::uint8_t>(tissue);
  for (std::ptrdiff_t x = -sx; x <= sx; x += sx)
    for (std::ptrdiff_t y = -sy; y <= sy; y += sy)
      for (std::ptrdiff_t z = -1; z <= 1; ++z)
        if (label[static_cast<std::size_t>(static_cast<std::ptrdiff_t>(n) + x + y + z)] == wanted)
          return true;
  return false;
}

LabelBlock label_block(const LayeredTooth& tooth, int cells) {
  LabelBlock block;
  const auto [low, high] = labelled_box(tooth.tissue);
  if (low.x() > high.x()) return block;
  const int longest = (high - low).maxCoeff() + 1;
  const int stride =
      std::max(1, static_cast<int>(std::lround(static_cast<double>(longest) / cells)));
  block.step = stride * tooth.lattice.voxel;
  block.size = ((high - low) / stride).array() + 3;
  block.origin = tooth.lattice.to_world(low) - Vec3::Constant(block.step);
  block.label.assign(static_cast<std::size_t>(block.size.x()) * block.size.y() * block.size.z(), 0);
  for (int x = 1; x < block.size.x() - 1; ++x)
    for (int y = 1; y < block.size.y() - 1; ++y)
      for (int z = 1; z < block.size.z() - 1; ++z)
        block.label[block.index(x, y, z)] = tooth.tissue.value(
            low.x() + stride * (x - 1), low.y() + stride * (y - 1), low.z() + stride * (z - 1));
  return block;
}

std::vector<std::size_t> dentin_pieces(const LabelBlock& block) {
  std::vector<std::size_t> sizes;
  std::vector<bool> wanted(block.label.size());
  for (std::size_t n = 0; n < wanted.size(); ++n)
    wanted[n] = block.at(n) == Tissue::kDentin || block.at(n) == Tissue::kPulp;
  const std::size_t sx = static_cast<std::size_t>(block.size.y()) * block.size.z(),
                    sy = static_cast<std::size_t>(block.size.z());
  std::vector<std::size_t> open;
  for (std::size_t n = 0; n < wanted.size(); ++n) {
    if (!wanted[n]) continue;
    std::size_t count = 0;
    wanted[n] = false;
    open.assign(1, n);
    while (!open.empty()) {
      const std::size_t at = open.back();
      open.pop_back();
      ++count;
      for (const std::size_t next : {at - sx, at + sx, at - sy, at + sy, at - 1, at + 1})
        if (wanted[next]) {
          wanted[next] = false;
          open.push_back(next);
        }
    }
    sizes.push_back(count);
  }
  std::sort(sizes.begin(), sizes.end(), std::greater<>());
  return sizes;
}

}  // namespace toothprep
