// The paper's layered block: top face at y = 0, centred in x and z, enamel on top of dentin.
#pragma once

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

struct BlockOptions {  // the paper's block
  Vec3 size{8, 8, 8};  // mm
  double enamel = 2;   // thickness of the enamel below the top face, mm, 0 .. size.y inclusive
  double voxel = 0.1;  // mm
  Pose pose;           // where the block's own frame (top face at y = 0) stands in W
};

// Exact signed distance to the axis-aligned box [low, high], mm.
[[nodiscard]] double box_distance(const Vec3& x, const Vec3& low, const Vec3& high);

// The voxels that cover a box, given in a frame of its own, which `pose` takes to W. Centres lie
// half a voxel beside the faces at low.x, high.y and low.z of a box that isn't turned.
struct BoxGrid {
  Lattice lattice;                                        // centres of the voxels
  Index3 lower = Index3::Zero(), upper = Index3::Zero();  // inclusive
};
[[nodiscard]] BoxGrid grid_of_box(const Vec3& low, const Vec3& high, double voxel,
                                  const Pose& pose);  // mm

// Throws Error if a size, the enamel or the voxel is not finite, not positive or out of range.
[[nodiscard]] LayeredTooth make_block(const BlockOptions& options);

}  // namespace toothprep
