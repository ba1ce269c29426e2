// The last step of voxelizing: from fields that are zero at the surfaces to a tooth.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"
#include "toothprep/tools/segmentation/signed_field.h"
#include "toothprep/tools/segmentation/work_box.h"

namespace toothprep {

// The tooth as fields over a box, each positive inside and nowhere zero: the solid, and each tissue
// against the other tissues (which matters in the solid and in a few voxels beyond its surface).
struct ToothFields {
  SignedField solid;
  std::array<SignedField, 3> tissue;  // enamel, dentin, pulp; empty if absent
  std::vector<std::uint8_t> label;    // the tissue here; of a scan air outside the solid
};

// `value`, moved to the given side of zero if it isn't there.
float signed_as(bool positive, float value);

// Fields to distances, and both to a tooth. A tissue is where the solid and its side of the
// interface both are, so its level set is the larger of the two distances, and the volumes of all
// tissues add up to the solid's.
//
// `box`: the fields'. `voxels`: those of the tooth, side by side from the same zero and not larger; where
// they are smaller the distances are interpolated, linear between the fields' voxels, and a voxel is of
// the tissue that it lies deepest in.
LayeredTooth tooth_of(const WorkBox& box, const ToothFields& fields, const WorkBox& voxels);

}  // namespace toothprep
