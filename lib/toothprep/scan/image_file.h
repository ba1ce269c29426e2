// CT files, by ITK: DICOM series (a folder), NRRD, NIfTI, MetaImage.
//
// Frames: everything that leaves this header stands in LPS, mm, as DICOM and ITK have it; a file in
// another space (RAS NIfTI or NRRD) is turned on reading.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "toothprep/core/image_volume.h"

namespace toothprep {

// Grey values as float (rescale slope and intercept applied), spacing in mm, direction and origin
// in LPS. `path` is a file (.nrrd, .nhdr, .nii, .nii.gz, .mha, .mhd) or a folder with one DICOM
// series, whose slices are ordered by their position. `spacing_mm`, if given, replaces the file's
// spacing and scales its origin along with it.
//
// Throws InputError for what can't be a scan: unreadable, truncated, empty, not 3-D, several
// components, NaN or infinity, a spacing that is absurd (not in 0.001 .. 5 mm), a dimension of one
// voxel, more than 2^31 voxels; in a folder: several series, slices missing, doubled or askew.
// Sizes are checked against the bytes that are there before memory is taken, so an error never
// depends on how much memory the machine has.
ImageVolume<float> read_scan(const std::string& path,
                             const std::optional<std::array<double, 3>>& spacing_mm = {});

// A label image; throws InputError as read_scan does, or if a value is not an integer in 0..65535.
ImageVolume<std::uint16_t> read_label_image(
    const std::string& path, const std::optional<std::array<double, 3>>& spacing_mm = {});

// SHA-256 of the file; of a folder: over the SHA-256 of its DICOM slices in the order of their
// position, so that names don't count.
std::string sha256_of_scan(const std::string& path);

// By extension: .nrrd, .nii, .nii.gz, .mha (the formats of one file), compressed where the format
// can; 16-bit signed grey values, or labels. Throws InputError for another extension, Error if it
// fails.
void write_image(const ImageVolume<std::int16_t>& image, const std::string& path);
void write_image(const ImageVolume<std::uint8_t>& image, const std::string& path);

// A CT Image Storage series, one file a slice (slice_0001.dcm ...), into the existing folder
// `folder`; UIDs are derived from the content, so that the same image gives the same bytes. Throws
// Error if it fails.
void write_dicom_series(const ImageVolume<std::int16_t>& image, const std::string& folder);

}  // namespace toothprep
