// The paper's layered block: top face at y = 0, centred in x and z, enamel on top of dentin.
#pragma once

#include "toothprep/tooth/layered_tooth.h"

namespace toothprep {

struct BlockOptions {
  Vec3 size{8, 8, 8};  // mm
  double enamel = 2;   // thickness of the enamel below the top face, mm, 0 .. size.y inclusive
  double voxel = 0.1;  // mm
  Pose pose;           // where the block's own frame (top face at y = 0) stands in W
};

// Throws Error if a size, the enamel or the voxel is not finite, not positive or out of range.
LayeredTooth make_block(const BlockOptions& options);

}  // namespace toothprep
