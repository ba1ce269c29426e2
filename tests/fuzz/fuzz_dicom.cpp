#include <filesystem>
#include <stdexcept>

#include "fuzz_target.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/scan_files/dicom_file.h"
#include "toothprep/tools/scan_files/dicom_header.h"
#include "toothprep/tools/scan_files/image_file.h"

namespace toothprep {
namespace {

// The elements, what they say about frames, then the frames themselves.
void read_dicom(const std::string& path) {
  try {
    const image::DicomFile dicom = image::parse_dicom(path);
    for (const auto& [tag, element] : dicom.top.elements) dicom.top.text(tag);
    const auto header = image::header_of(dicom, path);
    fuzz::require(!header || header->frames.size() <= std::filesystem::file_size(path));
  } catch (const std::runtime_error& e) {  // as its header says
    throw Error(e.what());
  }
  static_cast<void>(read_all(*open_scan(path)));
}

const fuzz::Registered k_dicom({"dicom", {"frames.dcm"}, read_dicom});

}  // namespace
}  // namespace toothprep
