// A DICOM folder (or one multi-frame file) to a volume: which series, its slices in the
// order of their positions, and a rectangular grid or the reason why there is none.
#pragma once

#include <string>
#include <vector>

#include "toothprep/core/image_volume.h"
#include "toothprep/scan/image_file.h"

namespace toothprep::image {

enum class Between { kLinear, kNearest };  // how irregular slices are resampled

// Values and place as read_scan has them, not yet checked for spacing and values. `path` is a
// folder or a multi-frame file. Throws InputError.
ImageVolume<float> read_dicom(const std::string& path, const ScanReadOptions& options,
                              Between between, std::vector<std::string>& notes);

// The files of one series of the folder, in the order of their positions.
std::vector<std::string> files_of_series(const std::string& folder, const std::string& series);

}  // namespace toothprep::image
