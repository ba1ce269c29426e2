// The signed distance to the surface where a sampled field is zero, at sub-voxel accuracy.
#pragma once

#include <vector>

#include "toothprep/step/core/geometry.h"

namespace toothprep {

// `field` has `size` samples (x fastest), positive inside, none of them zero. The surface is the
// field's zero, linear along the lattice's edges, triangulated cell by cell; the result is the
// exact Euclidean distance to these triangles in voxels, negative where the field is positive,
// clamped to +-band. Its error against the surface of a smooth field is that of linear
// interpolation, of second order in the voxel size. Independent of the number of threads.
std::vector<float> iso_distance(const Index3& size, const std::vector<float>& field, float band);

// The part of each row along x in which distances are wanted: from first to end - 1.
struct RowPart {
  int first = 0, end = 0;
};

// The same in the planes first .. last - 1 only, whose distances go to `distance`, row after row. What
// counts of the field are the planes as far away as the band, and one more. With `wanted`, a part for
// each of these rows, the other distances may be any within +-band.
void iso_distance_in(const Index3& size, const float* field, float band, int first, int last,
                     float* distance, const RowPart* wanted = nullptr);

}  // namespace toothprep
