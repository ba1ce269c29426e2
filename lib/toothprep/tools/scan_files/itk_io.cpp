#include "toothprep/tools/scan_files/itk_io.h"

#include <fcntl.h>
#include <gdcmTrace.h>
#include <itkMetaImageIO.h>
#include <itkNiftiImageIO.h>
#include <itkNrrdImageIO.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>

#include "toothprep/tools/scan_files/image_checks.h"

namespace toothprep::image {
namespace fs = std::filesystem;
namespace {

void flush() {
  std::cout.flush();
  std::cerr.flush();
  std::fflush(nullptr);
}

}  // namespace

void silence_libraries() {
  itk::Object::GlobalWarningDisplayOff();
  gdcm::Trace::DebugOff();
  gdcm::Trace::WarningOff();
  gdcm::Trace::ErrorOff();
  static std::ofstream nowhere("/dev/null");
  gdcm::Trace::SetStream(nowhere);
}

Silence::Silence() {
  silence_libraries();
  flush();
  const int nowhere = open("/dev/null", O_WRONLY);
  for (int i = 0; i < 2; ++i) {
    saved_[i] = dup(i + 1);
    if (nowhere >= 0 && saved_[i] >= 0) dup2(nowhere, i + 1);
  }
  if (nowhere >= 0) close(nowhere);
}

Silence::~Silence() {
  flush();
  for (int i = 0; i < 2; ++i)
    if (saved_[i] >= 0) {
      dup2(saved_[i], i + 1);
      close(saved_[i]);
    }
}

std::optional<Format> format_of(const std::string& path) {
  const std::string name = lower(fs::path(path).filename().string());
  if (name.ends_with(".nrrd") || name.ends_with(".nhdr")) return Format::kNrrd;
  if (name.ends_with(".nii") || name.ends_with(".nii.gz")) return Format::kNifti;
  if (name.ends_with(".mha") || name.ends_with(".mhd")) return Format::kMeta;
  return {};
}

const char* name_of(Format format) {
  return format == Format::kNrrd ? "NRRD" : format == Format::kNifti ? "NIfTI" : "MetaImage";
}

itk::ImageIOBase::Pointer io_of(Format format) {
  if (format == Format::kNrrd) return itk::NrrdImageIO::New().GetPointer();
  if (format == Format::kNifti) return itk::NiftiImageIO::New().GetPointer();
  return itk::MetaImageIO::New().GetPointer();
}

std::string description(const itk::ExceptionObject& e) {
  std::string text = trimmed(e.GetDescription());
  const auto nested = text.rfind("\n[nrrd]");
  if (nested != std::string::npos) text = trimmed(text.substr(nested + 1));
  text = text.substr(0, text.find('\n'));
  const auto mark = text.find("): ");
  if (lower(text).rfind("itk", 0) == 0 && mark != std::string::npos) text = text.substr(mark + 3);
  for (char& c : text)
    if (c == '\t' || c == '\r') c = ' ';
  return trimmed(text).substr(0, 300);
}

}  // namespace toothprep::image
