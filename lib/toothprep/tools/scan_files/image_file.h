// CT files, by ITK and GDCM: DICOM (a folder of slices, or one multi-frame file), NRRD, NIfTI,
// MetaImage.
//
// Frames: everything that leaves this header stands in LPS, mm, as DICOM and ITK have it; a file in
// another space (RAS NIfTI or NRRD) is turned on reading.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/io/image_volume.h"
#include "toothprep/tools/scan_files/scan_source.h"

namespace toothprep {

struct ScanReadOptions {  // where a file can't say so itself
  // mm; replaces the file's spacing and scales its origin along with it.
  std::optional<std::array<double, 3>> spacing_mm;

  // Which series of a DICOM folder: its place in list_series (1 is the first; "#1" if that number
  // is also another's series number), its series number, its UID or the end of it, or its
  // description (whole, else its beginning, else a part of it; capitals don't matter). It must
  // mean exactly one series. Empty: the only one there is.
  std::string series;

  // DICOM: resample slices that are missing, irregular or sheared by a tilted gantry, linearly
  // (labels: nearest), to a rectangular grid whose step is the median one. Not resampled but still
  // refused: slices at the same position, a gap of more than 5 steps, a tilt of more than 45
  // degrees, slices shifted sideways by unequal amounts.
  bool allow_irregular = false;

  bool labels = false;  // the values are labels, which nothing may mix

  // Which component of a vector image or which volume of a 4-D file (not DICOM); 1 is the first.
  std::optional<int> component;
};

// Grey values as float (rescale slope and intercept applied), spacing in mm, direction and origin
// in LPS. `path` is a file (.nrrd, .nhdr, .nii, .nii.gz, .mha, .mhd, or a DICOM file with several
// frames) or a folder with a DICOM series, whose slices (or frames) are ordered by their position.
// Headers are read and checked here, values slab by slab when they are asked for.
//
// Throws InputError for what can't be a scan: unreadable, truncated, empty, not 3-D, several
// components, a spacing that is absurd (not in 0.001 .. 5 mm, no number, or stated twice with
// different values), a dimension of one voxel, a header that promises more or fewer voxels than the
// file holds; in a folder: several series, slices missing, doubled or askew, or stored otherwise
// than the rest. Damaged voxel data, NaN, infinity, and more than 2^31 voxels that are to be read
// are errors on reading. Sizes are checked against the bytes that are there, and against the memory
// of the machine, before memory is taken.
std::unique_ptr<ScanSource> open_scan(const std::string& path, const ScanReadOptions& options = {});

// The whole of it. What was changed or assumed on the way is in `notes`, a sentence each.
[[nodiscard]] ImageVolume<float> read_scan(const std::string& path, const ScanReadOptions& options,
                                           std::vector<std::string>* notes = nullptr);
ImageVolume<float> read_scan(const std::string& path,
                             const std::optional<std::array<double, 3>>& spacing_mm = {});

// A label image; throws InputError as read_scan does, or if a value is not an integer in 0..65535.
[[nodiscard]] ImageVolume<std::uint16_t> read_label_image(
    const std::string& path, ScanReadOptions options, std::vector<std::string>* notes = nullptr);
ImageVolume<std::uint16_t> read_label_image(
    const std::string& path, const std::optional<std::array<double, 3>>& spacing_mm = {});

struct SeriesInfo {                        // of a DICOM folder
  int place = 0;                           // in the list, 1 is the first
  std::optional<int> number;               // DICOM's series number
  std::string uid, description, modality;  // as DICOM has them
  int slices = 0, columns = 0, rows = 0;   // size of the first slice

  bool operator==(const SeriesInfo&) const = default;  // all members
};

// The DICOM series in a folder, by series number, then UID. Throws InputError if there is none.
[[nodiscard]] std::vector<SeriesInfo> list_series(const std::string& folder);

// SHA-256 of the file, or if its voxels are in others, over the SHA-256 of all; of a folder:
// over the SHA-256 of the DICOM files of the series (see ScanReadOptions) in the order of their
// positions, so that names don't count.
// Once `stop` is set it comes back soon, with no hash of anything.
std::string sha256_of_scan(const std::string& path, const std::string& series = {},
                           const std::atomic<bool>* stop = nullptr);

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
