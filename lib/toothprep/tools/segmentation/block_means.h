// A scan in coarser voxels: means over blocks, gathered slab by slab.
#pragma once

#include <vector>

#include "toothprep/tools/segmentation/crop.h"

namespace toothprep {

class BlockMeans {
 public:
  // Of the part's voxels, `block` of them along each axis. Voxels that fill no block at the upper
  // faces are left out.
  BlockMeans(const ImageFrame& scan, const VoxelRange& part, const Index3& block);

  // Slices first .. first + count - 1 of the scan; each slice once, upwards. The sums don't depend
  // on how slices are grouped.
  void add(int first, int count, const float* slices);

  // The means, placed at the blocks' centres. Call once.
  ImageVolume<float> take();

 private:
  Index3 scan_size_;
  VoxelRange part_;
  Index3 block_;
  ImageVolume<float> means_;
};

// The whole scan.
VoxelRange whole_of(const ImageFrame& scan);

}  // namespace toothprep
