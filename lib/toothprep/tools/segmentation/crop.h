// A part of a scan: what is left of it is treated as a scan of its own.
#pragma once

#include <memory>

#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/scan_files/scan_source.h"

namespace toothprep {

// The smallest block of the image's voxels that holds a box of W (LPS, mm), as far as there are
// voxels; of an oblique image it is larger than the box.
VoxelRange voxels_around(const ImageFrame& image, const Box& box);

ImageFrame frame_of(const ImageFrame& image, const VoxelRange& part);

// The voxels around the box; the place of each stays. Throws Error if the box's corners are not in
// order or less than two voxels along an axis are left.
std::unique_ptr<ScanSource> crop(std::unique_ptr<ScanSource> scan, const Box& box);

}  // namespace toothprep
