// The signed distance to the surface where a sampled field is zero, at sub-voxel accuracy.
#pragma once

#include <vector>

#include "toothprep/step/core/geometry.h"
#include "toothprep/tools/segmentation/signed_field.h"

namespace toothprep {

// `field` has `size` samples (x fastest), positive inside, none of them zero. The surface is the
// field's zero, linear along the lattice's edges, triangulated cell by cell; the result is the
// exact Euclidean distance to these triangles in voxels, negative where the field is positive,
// clamped to +-band. Its error against the surface of a smooth field is that of linear
// interpolation, of second order in the voxel size. Independent of the number of threads.
std::vector<float> iso_distance(const Index3& size, const std::vector<float>& field, float band);

// A field and where its distances go, row after row. With `wanted`, a part for each of these rows, the
// other distances may be any within +-band.
struct IsoField {
  const SignedField* field = nullptr;  // of `size` samples
  float* distance = nullptr;
  const RowPart* wanted = nullptr;
};

// The same in the planes first .. last - 1 only. `opposite` are fields whose surfaces are for the most part
// those of the field from the other side, as a tissue's are of its neighbours': what two surfaces
// share is gone through once, with the same results. What is wanted of the field must be wanted of
// them, too.
void iso_distance_in(const Index3& size, const IsoField& of, float band, int first, int last,
                     const std::vector<IsoField>& opposite = {});

}  // namespace toothprep
