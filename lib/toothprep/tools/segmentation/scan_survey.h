// One pass over a scan: what its grey classes are found on, and its greys at the resolution of the
// tooth.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "toothprep/tools/segmentation/block_means.h"

namespace toothprep {

struct ScanSurvey {
  Index3 class_block = Index3::Ones();
  ImageVolume<float> class_means;  // see block_for_classes
  // The scan in blocks no larger than the tooth's voxels, if that needs little memory: then the
  // scan is read once.
  std::optional<ImageVolume<float>> greys;
  std::vector<float> values;  // the distinct values, while there are fewer than kManyValues
  float highest = 0;          // grey value
  std::size_t voxels_at_highest = 0;
};
constexpr std::size_t kManyValues = 9;

// `voxel`: of the tooth, mm. `progress` gets the share that is read.
ScanSurvey survey(ScanSource& scan, double voxel, const std::function<void(double)>& progress);

// Only the part's greys, in the same blocks: a second pass.
ImageVolume<float> greys_of(ScanSource& scan, double voxel, const VoxelRange& part,
                            const std::function<void(double)>& progress);

}  // namespace toothprep
