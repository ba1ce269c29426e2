// The grey values of a DICOM file's frames.
#pragma once

#include <string>
#include <vector>

#include "toothprep/scan/dicom_header.h"

namespace toothprep::image {

// All frames of the file, one after the other, rescaled. `lossy` is set if the compression loses
// something. Throws InputError with `path` and the file's name.
std::vector<float> pixels_of(const std::string& path, const DicomHeader& header, bool& lossy);

}  // namespace toothprep::image
