// One tooth out of a segmentation of several.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "toothprep/tools/segmentation/voxelize.h"

namespace toothprep {

struct LabelTooth {            // enamel, dentin and pulp that hang together by faces
  Vec3 centre = Vec3::Zero();  // mm, W
  Box bounds;                  // mm, W, of the voxels' centres
  double volume = 0;           // mm³
};

// Clears (sets to 0) what does not belong to the tooth that `options` choose; labels of `other`
// (`tissue_of`: by label value) stay within 1 mm of its box. Returns a note that lists the teeth.
// Throws Error if that tooth is not there.
std::string keep_one_tooth(ImageVolume<std::uint16_t>& labels,
                           const std::vector<std::uint8_t>& tissue_of,
                           const VoxelizeOptions& options);

}  // namespace toothprep
