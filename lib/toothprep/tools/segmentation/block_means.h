// A scan in coarser voxels: means over blocks, gathered slab by slab.
#pragma once

#include <vector>

#include "toothprep/tools/segmentation/crop.h"

namespace toothprep {

class BlockMeans {
 public:
  // Of the part's voxels, `block` of them along each axis. Voxels that fill no block at the upper
  // faces are left out. `whole_up_to`: of the source.
  BlockMeans(const ImageFrame& scan, const VoxelRange& part, const Index3& block,
             double whole_up_to);

  // The part's voxels in slices first .. first + count - 1 of the scan; each slice once, upwards. The sums don't
  // depend on how slices are grouped.
  void add(int first, int count, const float* slices);

  // The means, placed at the blocks' centres. Call once.
  ImageVolume<float> take();

 private:
  void add_blocks(const float* row, float* sums) const;

  VoxelRange part_;
  Index3 block_;
  bool exact_;  // the sums, in whichever order
  ImageVolume<float> means_;
};

}  // namespace toothprep
