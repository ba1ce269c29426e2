// NRRD, NIfTI and MetaImage, by ITK, against the bytes that are there.
#pragma once

#include <Eigen/Dense>
#include <optional>
#include <string>

#include "toothprep/core/image_volume.h"

namespace toothprep::image {

bool is_volume_file(const std::string& path);  // by extension

// Values and place as read_scan has them, size checked but not yet spacing and values. `component`
// is 1 for the first. Throws InputError.
ImageVolume<float> read_volume_file(const std::string& path, std::optional<int> component);

// Where the voxels are if the header (.nhdr, .mhd) says that they are in one other file; else
// empty.
std::string detached_data_of(const std::string& path);

}  // namespace toothprep::image
