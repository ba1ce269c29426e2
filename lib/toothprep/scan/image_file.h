// CT files, by ITK: DICOM series (a folder), NRRD, NIfTI, MetaImage.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "toothprep/core/image_volume.h"

namespace toothprep {

// Grey values as float (rescale slope and intercept applied), spacing in mm, direction and origin in
// LPS. `spacing_mm`, if given, replaces the file's spacing and scales its origin along with it.
// Throws InputError for what can't be a scan: unreadable, truncated, empty, not 3-D, several components, NaN,
// a spacing that is absurd (not in 0.001 .. 5 mm), a dimension of one voxel, more than 2^31 voxels. An error
// never depends on how much memory the machine has.
ImageVolume<float> read_scan(const std::string& path,
                             const std::optional<std::array<double, 3>>& spacing_mm = {});

// A label image; throws InputError if a value is not an integer in 0..65535.
ImageVolume<std::uint16_t> read_label_image(
    const std::string& path, const std::optional<std::array<double, 3>>& spacing_mm = {});

// By extension: .nrrd, .nii, .nii.gz, .mha, .mhd; 16-bit signed grey values.
void write_image(const ImageVolume<std::int16_t>& image, const std::string& path);
void write_image(const ImageVolume<std::uint8_t>& image, const std::string& path);

// A CT Image Storage series, one file a slice, into the existing folder `folder`; UIDs are derived from
// the content, so that the same image gives the same bytes.
void write_dicom_series(const ImageVolume<std::int16_t>& image, const std::string& folder);

}  // namespace toothprep
