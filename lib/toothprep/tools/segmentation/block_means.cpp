#include "toothprep/tools/segmentation/block_means.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <utility>

#include "toothprep/tools/segmentation/wide_vectors.h"

namespace toothprep {
namespace {

constexpr double kExact = 1 << 24;  // up to here all whole numbers are single precision's, too

void add_to(const float* values, std::size_t count, float* sums) {
  for (std::size_t i = 0; i < count; ++i) sums[i] += values[i];
}

}  // namespace

BlockMeans::BlockMeans(const ImageFrame& scan, const VoxelRange& part, const Index3& block,
                       double whole_up_to)
    : part_(part),
      block_(block.cwiseMin(part.size())),
      exact_(whole_up_to * block_.cast<double>().prod() <= kExact) {
  static_cast<ImageFrame&>(means_) = scan;
  means_.size = part.size().cwiseQuotient(block_);
  means_.spacing = scan.spacing.cwiseProduct(block_.cast<double>());
  const Vec3 centre = 0.5 * (block_ - Index3::Ones()).cast<double>();
  means_.origin = scan.to_world(part.first.cast<double>() + centre);
  means_.data.resize(means_.voxels());
}

void BlockMeans::add(int first, int count, const float* slices) {
  const auto row = static_cast<std::size_t>(part_.size().x()),
             rows = static_cast<std::size_t>(part_.size().y());
  const int high = std::min(first + count, part_.first.z() + means_.size.z() * block_.z());
  tbb::parallel_for(0, means_.size.y(), [&](int j) {
    std::vector<float> column(exact_ ? row : 0);
    with_wide_vectors([&] {
      for (int z = first; z < high; ++z) {
        const float* in = slices + (static_cast<std::size_t>(z - first) * rows +
                                    static_cast<std::size_t>(j * block_.y())) *
                                       row;
        float* out = means_.data.data() + means_.offset(0, j, (z - part_.first.z()) / block_.z());
        // Rows onto each other first is by vectors.
        if (exact_ && block_.y() > 1) {
          for (std::size_t x = 0; x < row; ++x) column[x] = in[x] + in[row + x];
          for (int y = 2; y < block_.y(); ++y)
            add_to(in + static_cast<std::size_t>(y) * row, row, column.data());
          add_blocks(column.data(), out);
        } else {
          for (int y = 0; y < block_.y(); ++y, in += row) add_blocks(in, out);
        }
      }
    });
  });
}

// A row to the sums of a row of blocks.
void BlockMeans::add_blocks(const float* row, float* sums) const {
  const int n = means_.size.x(), b = block_.x();
  if (b == 1) return add_to(row, static_cast<std::size_t>(n), sums);
  if (b == 2) {
    for (int i = 0; i < n; ++i) sums[i] += row[2 * i] + row[2 * i + 1];
    return;
  }
  for (int i = 0; i < n; ++i, row += b) {
    float sum = 0;
    for (int x = 0; x < b; ++x) sum += row[x];
    sums[i] += sum;
  }
}

ImageVolume<float> BlockMeans::take() {
  const auto share = static_cast<float>(1.0 / block_.cast<double>().prod());
  if (block_ != Index3::Ones())
    for (float& v : means_.data) v *= share;
  return std::move(means_);
}

}  // namespace toothprep
