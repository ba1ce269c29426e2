// A libFuzzer target: the DICOM parser on any bytes gives a file or an error, and what the elements
// say about frames gives a header or none, never more. Built and run by scripts/fuzz.
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <stdexcept>
#include <string>

#include "toothprep/tools/scan_files/dicom_file.h"
#include "toothprep/tools/scan_files/dicom_header.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const std::string path = "/dev/shm/fuzz-dicom-" + std::to_string(getpid());
  std::FILE* file = std::fopen(path.c_str(), "wb");
  if (!file) return 0;
  std::fwrite(data, 1, size, file);
  std::fclose(file);
  try {
    const toothprep::image::DicomFile dicom = toothprep::image::parse_dicom(path);
    dicom.number(0x00280010);
    for (const auto& [tag, element] : dicom.top.elements) dicom.top.text(tag);
    const auto header = toothprep::image::header_of(dicom, path);
    if (header && header->frames.size() > size) __builtin_trap();  // more than could be described
  } catch (const std::runtime_error&) {
  }
  std::remove(path.c_str());
  return 0;
}
