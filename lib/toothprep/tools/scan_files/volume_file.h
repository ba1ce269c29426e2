// NRRD, NIfTI and MetaImage, by ITK, against the bytes that are there.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/scan_files/scan_source.h"

namespace toothprep::image {

bool is_volume_file(const std::string& path);  // by extension

// Values and place as open_scan has them, size checked but not yet spacing and values. Slices are
// read from the file when they are asked for; only encodings that are rarely met (ASCII, bzip2,
// bytes to be skipped, several data files) are read as a whole, by ITK. `component` is 1 for the
// first. Throws InputError.
std::unique_ptr<ScanSource> open_volume_file(
    const std::string& path, std::optional<int> component,
    const std::optional<std::array<double, 3>>& spacing_mm);

// Where the voxels are if the header (.nhdr, .mhd) says that they are in other files; else empty.
std::vector<std::string> detached_data_of(const std::string& path);

}  // namespace toothprep::image
