// What voxelizing needs done to dense arrays of voxels: components and distances (by ITK),
// smoothing.
//
// Arrays are x-fastest with `size` voxels; lengths are in voxels. Results don't depend on the
// number of threads, which is TBB's (ITK's own pool is held to it).
#pragma once

#include <cstdint>
#include <vector>

#include "toothprep/step/core/geometry.h"

namespace toothprep {

using Mask = std::vector<std::uint8_t>;  // 0 or 1

struct Components {
  std::vector<std::uint32_t> label;   // 0 outside the mask, then 1, 2, ... from the largest down
  std::vector<std::size_t> voxels;    // voxels[label - 1]
  std::vector<std::uint8_t> at_edge;  // at_edge[label - 1]: touches the array's outermost voxels
  std::size_t count() const { return voxels.size(); }
};

// Components of the mask whose voxels share faces.
Components connected_components(const Index3& size, const Mask& mask);

// Keeps the largest component of the mask; an empty mask stays empty.
void keep_largest_component(const Index3& size, Mask& mask);

// Sets every voxel that is not connected (by faces, outside the mask) with the array's edge.
void fill_enclosed(const Index3& size, Mask& mask);

// Euclidean distance from each voxel's centre to that of the nearest voxel in the mask; 0 inside
// it, infinity where the mask is empty.
std::vector<float> distance_to(const Index3& size, const Mask& mask);

// Distance below the mask's surface: positive inside, negative outside, the surface taken half-way
// between centres of unlike neighbours. The mask must neither be empty nor full.
std::vector<float> depth_below_surface(const Index3& size, const Mask& mask);

// Gaussian smoothing; the array's edge values are continued outside. sigma in voxels; 0 does
// nothing.
void smooth(const Index3& size, std::vector<float>& values, double sigma);

}  // namespace toothprep
