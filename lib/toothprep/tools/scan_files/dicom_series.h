// A DICOM folder (or one multi-frame file) to a volume: which series, its slices in the
// order of their positions, and a rectangular grid or the reason why there is none.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "toothprep/tools/scan_files/image_file.h"

namespace toothprep::image {

// Values and place as open_scan has them; `path` is a folder or a multi-frame file. The headers are
// read and checked here, pixels when their slices are asked for (all at once where slices are
// irregular). Throws InputError.
std::unique_ptr<ScanSource> open_dicom(const std::string& path, const ScanReadOptions& options);

// The files of one series of the folder, in the order of their positions.
std::vector<std::string> files_of_series(const std::string& folder, const std::string& series);

}  // namespace toothprep::image
