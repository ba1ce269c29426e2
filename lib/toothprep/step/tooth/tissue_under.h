// The tissue under a point of the surface: what a mesh or a display colours it by.
#pragma once

#include <limits>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// The label of the tissue at the point `s` (0 .. 1) of the way from the voxel `inside` to its
// neighbour `outside`, between which the surface passes. The tissues' own level sets place their
// border within a voxel, where enamel thins out for one. `remaining_inside` and `remaining_outside`
// (mm) are what remains of the solid at the two voxels where more was cut than `tooth` knows.
std::uint8_t tissue_under(const LayeredTooth& tooth, const Index3& inside, const Index3& outside,
                          double s, float remaining_inside = std::numeric_limits<float>::lowest(),
                          float remaining_outside = std::numeric_limits<float>::lowest());

}  // namespace toothprep
