// ITK's readers and writers of the formats that are taken, without their messages. For this module's own
// .cpp files.
#pragma once

#include <Eigen/Dense>

// All of Eigen stands before ITK, which brings an older copy of it with the same include guards.
#include <itkImageIOBase.h>
#include <itkMacro.h>

#include <array>
#include <optional>
#include <string>

namespace toothprep::image {

enum class Format { kNrrd, kNifti, kMeta };

std::optional<Format> format_of(const std::string& path);  // by extension
const char* name_of(Format format);
itk::ImageIOBase::Pointer io_of(Format format);

// The heart of an ITK message: without the class and its address; one line (of NRRD's nested ones
// the last, which is the cause).
std::string description(const itk::ExceptionObject& e);

// ITK and GDCM talk on stderr by themselves; a failure here is one exception and nothing else.
void silence_libraries();

// MetaIO and the NIfTI library print their complaints unconditionally. While one of these lives,
// what is printed goes nowhere; the failure itself comes as an exception or is found by the checks
// of the readers.
class Silence {
 public:
  Silence();
  ~Silence();
  Silence(const Silence&) = delete;
  Silence& operator=(const Silence&) = delete;

 private:
  std::array<int, 2> saved_{};  // stdout, stderr
};

}  // namespace toothprep::image
