// Which tissue is where inside a tooth, as a texture for the faces of sections.
#pragma once

#include <string>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

struct TissueVolume {
  Index3 counts = Index3::Zero();  // samples along x, y, z
  Vec3 origin = Vec3::Zero();      // mm, W: of the first sample
  double spacing = 0;              // mm
  // Per sample, x fastest, a byte for each tissue in their order: how far the sample lies inside of
  // it, 128 at its border. The tissue of a place is the one with the largest interpolated value.
  std::string samples;
};

// Of the tooth's box; every second voxel, or third, ... if there are more than some millions.
[[nodiscard]] TissueVolume tissue_volume(const LayeredTooth& tooth);

}  // namespace toothprep
