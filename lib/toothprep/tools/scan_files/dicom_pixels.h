// The grey values of a DICOM file's frames.
#pragma once

#include <memory>
#include <string>

#include "toothprep/tools/io/trial.h"
#include "toothprep/tools/scan_files/dicom_header.h"

namespace toothprep::image {

class DicomPixels {
 public:
  // Of a file whose header was read. Compressed pixels are decoded here, all at once; others are
  // read when they are asked for. Throws InputError with `path` and the file's name. `header` must
  // stay.
  DicomPixels(const std::string& path, const DicomHeader& header);
  ~DicomPixels();

  // The frame's greys (rows * columns), rescaled. For several threads at once.
  void read(std::size_t frame, float* greys) const;

  bool lossy() const { return lossy_; }  // the compression loses something

 private:
  const DicomHeader& header_;
  DicomFile file_;
  std::unique_ptr<SharedMemory> decoded_;
  bool lossy_ = false;
};

}  // namespace toothprep::image
