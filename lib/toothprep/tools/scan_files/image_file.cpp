#include "toothprep/tools/scan_files/image_file.h"

#include <filesystem>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/tools/io/input_file.h"
#include "toothprep/tools/scan_files/dicom_file.h"
#include "toothprep/tools/scan_files/dicom_series.h"
#include "toothprep/tools/scan_files/image_checks.h"
#include "toothprep/tools/scan_files/volume_file.h"

namespace toothprep {
namespace fs = std::filesystem;

std::unique_ptr<ScanSource> open_scan(const std::string& path, const ScanReadOptions& options) {
  std::error_code error;
  if (fs::is_directory(path, error)) return image::open_dicom(path, options);
  const std::uint64_t size = InputFile(path).size();
  if (!options.series.empty())
    throw InputError(path, "series", "can only be chosen in a folder of DICOM files");
  if (image::is_volume_file(path)) {
    if (size == 0) throw InputError(path, "", "is empty");
    return image::open_volume_file(path, options.component, options.spacing_mm);
  }
  if (image::is_dicom_file(path)) return image::open_dicom(path, options);
  throw InputError(path, "", "is not a scan format that is known",
                   "give a folder with a DICOM series, or .nrrd, .nii, .nii.gz, .mha, .mhd");
}

namespace {

// Calls read(source), then takes the notes.
auto whole(const std::string& path, const ScanReadOptions& options, std::vector<std::string>* notes,
           auto read) {
  const auto source = open_scan(path, options);
  auto volume = read(*source);
  const auto own = source->notes();
  if (notes) notes->insert(notes->end(), own.begin(), own.end());
  return volume;
}

ScanReadOptions spaced(const std::optional<std::array<double, 3>>& spacing_mm) {
  ScanReadOptions options;
  options.spacing_mm = spacing_mm;
  return options;
}

}  // namespace

ImageVolume<float> read_scan(const std::string& path, const ScanReadOptions& options,
                             std::vector<std::string>* notes) {
  return whole(path, options, notes, [](ScanSource& source) { return read_all(source); });
}

ImageVolume<float> read_scan(const std::string& path,
                             const std::optional<std::array<double, 3>>& spacing_mm) {
  return read_scan(path, spaced(spacing_mm));
}

ImageVolume<std::uint16_t> read_label_image(const std::string& path, ScanReadOptions options,
                                            std::vector<std::string>* notes) {
  options.labels = true;
  return whole(path, options, notes, [](ScanSource& source) { return read_labels(source); });
}

ImageVolume<std::uint16_t> read_label_image(
    const std::string& path, const std::optional<std::array<double, 3>>& spacing_mm) {
  return read_label_image(path, spaced(spacing_mm));
}

std::string sha256_of_scan(const std::string& path, const std::string& series,
                           const std::atomic<bool>* stop) {
  std::error_code error;
  std::vector<std::string> files;
  if (fs::is_directory(path, error)) {
    files = image::files_of_series(path, series);
  } else {
    if (image::is_volume_file(path)) files = image::detached_data_of(path);
    if (files.empty()) return sha256_of_file(path, stop);
    files.insert(files.begin(), path);
  }
  Sha256 all;
  for (const auto& file : files) {
    const std::string one = sha256_of_file(file, stop);
    all.update(one.data(), one.size());
  }
  return all.hex();
}

}  // namespace toothprep
