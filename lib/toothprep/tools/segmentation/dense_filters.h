// What voxelizing needs done to dense arrays of voxels: distances (by ITK), smoothing.
//
// Arrays are x-fastest with `size` voxels; lengths are in voxels. Results don't depend on the
// number of threads, which is TBB's (ITK's own pool is held to it).
#pragma once

#include <cstdint>
#include <vector>

#include "toothprep/step/core/geometry.h"
#include "toothprep/tools/segmentation/mask_parts.h"

namespace toothprep {

// Euclidean distance from each voxel's centre to that of the nearest voxel in the mask; 0 inside
// it, infinity where the mask is empty. However far; near_distance.h has it for a neighbourhood, in a
// tenth of the time.
std::vector<float> distance_to(const Index3& size, const Mask& mask);

// Gaussian smoothing; the array's edge values are continued outside. sigma in voxels; 0 does
// nothing.
void smooth(const Index3& size, std::vector<float>& values, double sigma);

}  // namespace toothprep
