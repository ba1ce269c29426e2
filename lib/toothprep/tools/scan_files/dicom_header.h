// What a DICOM file says about its frames, before any pixel is touched: a slice of a series is one
// frame with its place in the file's own tags; in a multi-frame file (Enhanced CT, X-ray 3D,
// multi-frame secondary capture) the place stands in the functional groups, each frame's own
// (5200,9230) before the shared ones (5200,9229). Source: DICOM PS3.3, C.7.6.16.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "toothprep/tools/scan_files/dicom_file.h"

namespace toothprep::image {

struct DicomFrame {
  std::vector<double> position, orientation;  // mm and cosines, LPS; 3 and 6 values if stated
  std::vector<double> pixel_spacing;          // mm, between rows, between columns
  std::string pixel_spacing_text;             // as it stands there
  double slope = 1, intercept = 0;            // grey value = slope * stored value + intercept
};

struct DicomHeader {
  std::string file;
  std::string series_uid, series_description, modality, photometric;
  std::optional<int> series_number;
  int rows = 0, columns = 0, samples = 1;
  int bits_allocated = 16, bits_stored = 16, high_bit = 15;
  bool is_signed = false;
  bool bad_rescale = false;  // a slope or intercept that is no number, or a look-up table
  int stated_frames = 1;
  std::vector<DicomFrame> frames;  // those that are described, in the file's order
};

// Nothing if it is no image (a directory, a report).
std::optional<DicomHeader> header_of(const DicomFile& dicom, const std::string& file);

}  // namespace toothprep::image
