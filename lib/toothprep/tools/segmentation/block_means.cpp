#include "toothprep/tools/segmentation/block_means.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <utility>

namespace toothprep {

VoxelRange whole_of(const ImageFrame& scan) { return {Index3::Zero(), scan.size - Index3::Ones()}; }

BlockMeans::BlockMeans(const ImageFrame& scan, const VoxelRange& part, const Index3& block)
    : scan_size_(scan.size), part_(part), block_(block.cwiseMin(part.size())) {
  static_cast<ImageFrame&>(means_) = scan;
  means_.size = part.size().cwiseQuotient(block_);
  means_.spacing = scan.spacing.cwiseProduct(block_.cast<double>());
  const Vec3 centre = 0.5 * (block_ - Index3::Ones()).cast<double>();
  means_.origin = scan.to_world(part.first.cast<double>() + centre);
  means_.data.resize(means_.voxels());
}

void BlockMeans::add(int first, int count, const float* slices) {
  const Index3 size = means_.size, b = block_;
  const auto row = static_cast<std::size_t>(scan_size_.x());
  const std::size_t area = row * static_cast<std::size_t>(scan_size_.y());
  const int low = std::max(first, part_.first.z());
  const int high = std::min(first + count, part_.first.z() + size.z() * b.z());
  tbb::parallel_for(0, size.y(), [&](int j) {
    for (int z = low; z < high; ++z) {
      float* out = means_.data.data() + means_.offset(0, j, (z - part_.first.z()) / b.z());
      for (int y = 0; y < b.y(); ++y) {
        const float* in = slices + static_cast<std::size_t>(z - first) * area +
                          static_cast<std::size_t>(part_.first.y() + j * b.y() + y) * row +
                          static_cast<std::size_t>(part_.first.x());
        if (b.x() == 1)
          for (int i = 0; i < size.x(); ++i) out[i] += in[i];
        else
          for (int i = 0; i < size.x(); ++i, in += b.x()) {
            float sum = 0;
            for (int x = 0; x < b.x(); ++x) sum += in[x];
            out[i] += sum;
          }
      }
    }
  });
}

ImageVolume<float> BlockMeans::take() {
  const auto share = static_cast<float>(1.0 / block_.cast<double>().prod());
  if (block_ != Index3::Ones())
    for (float& v : means_.data) v *= share;
  return std::move(means_);
}

}  // namespace toothprep
