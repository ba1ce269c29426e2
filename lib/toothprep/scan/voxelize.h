// A CT scan, or a segmentation made elsewhere, to a layered tooth.
#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>

#include "toothprep/core/image_volume.h"
#include "toothprep/tooth/layered_tooth.h"

namespace toothprep {

struct VoxelizeOptions {
  double voxel = 0.1;  // mm, of the tooth
  // Grey values of the borders surroundings|dentin and dentin|enamel; automatic when absent.
  std::optional<std::array<double, 2>> thresholds;
};

// Grey scan to tooth. Throws Error when no tooth can be told from its surroundings (flat image, one
// class, nothing but noise), naming what was found.
LayeredTooth voxelize_scan(const ImageVolume<float>& scan, const VoxelizeOptions& options);

// Labels to tooth. `tissues` maps label values to tissues; label values not named are air. Throws Error
// if no named label occurs.
LayeredTooth voxelize_labels(const ImageVolume<std::uint16_t>& labels,
                             const std::map<std::uint16_t, Tissue>& tissues,
                             const VoxelizeOptions& options);

}  // namespace toothprep
