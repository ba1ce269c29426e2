// From labels to fields whose zero surfaces have no steps.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "toothprep/step/core/tissue.h"
#include "toothprep/tools/io/image_volume.h"
#include "toothprep/tools/segmentation/tooth_fields.h"

namespace toothprep {

struct LabelTissues {  // a segmentation's anatomy
  const ImageVolume<std::uint16_t>& labels;
  const std::vector<std::uint8_t>& tissue_of;  // Tissue by label value
  Index3 low, high;                            // of the voxels that are tissue, inclusive
  PerTissue<double> volume_mm3;                // of the labels
};

// The solid's surface and the interfaces of tissues, each by LabelSurface, on the output lattice;
// where the lattice is more than twice as coarse as the labels, averaged over its voxels. An
// interface is found inside the solid alone and goes on straight through its surface, and of the
// tissues' fields the largest wins: there are neither gaps nor overlaps. Each field is shifted by
// what restores its volume, by half a label voxel at most. Throws Error if there is not the memory.
ToothFields smooth_label_fields(const LabelTissues& anatomy, const WorkBox& box);

}  // namespace toothprep
