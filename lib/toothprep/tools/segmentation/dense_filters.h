// What voxelizing needs done to dense arrays of voxels: distances (by ITK), smoothing.
//
// Arrays are x-fastest with `size` voxels; lengths are in voxels. Results don't depend on the
// number of threads, which is TBB's (ITK's own pool is held to it).
#pragma once

#include <functional>
#include <vector>

#include "toothprep/step/core/geometry.h"
#include "toothprep/tools/segmentation/band_field.h"
#include "toothprep/tools/segmentation/mask_parts.h"

namespace toothprep {

// Euclidean distance from each voxel's centre to that of the nearest voxel in the mask; 0 inside
// it, infinity where the mask is empty. However far; near_distance.h has it for a neighbourhood, in a
// tenth of the time.
std::vector<float> distance_to(const Index3& size, const Mask& mask);

// Gaussian smoothing; the array's edge values are continued outside. sigma in voxels; 0 does
// nothing.
void smooth(const Index3& size, std::vector<float>& values, double sigma);

// The same of what `fill` gives plane by plane, never held as a whole, and only for the voxels that
// `field` has: take(v, value) is called for each. Both from several threads. sigma above zero.
void smooth_where(const Index3& size, double sigma, const BandField& field,
                  const std::function<void(int k, float* plane)>& fill,
                  const std::function<void(std::size_t v, float value)>& take);

}  // namespace toothprep
