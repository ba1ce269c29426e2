#include "toothprep/scan/image_file.h"

#include <cmath>
#include <filesystem>
#include <fstream>

#include "toothprep/core/errors.h"
#include "toothprep/core/hash.h"
#include "toothprep/scan/dicom_file.h"
#include "toothprep/scan/dicom_series.h"
#include "toothprep/scan/image_checks.h"
#include "toothprep/scan/volume_file.h"

namespace toothprep {
namespace fs = std::filesystem;
namespace {

ImageVolume<float> read(const std::string& path, const ScanReadOptions& options,
                        image::Between between, std::vector<std::string>* notes) {
  std::error_code error;
  const auto status = fs::status(path, error);
  if (!fs::exists(status)) throw InputError(path, "", "does not exist");
  ImageVolume<float> volume;
  std::vector<std::string> told;
  if (fs::is_directory(status)) {
    volume = image::read_dicom(path, options, between, told);
  } else {
    if (!std::ifstream(path, std::ios::binary)) throw InputError(path, "", "cannot be read");
    if (!options.series.empty())
      throw InputError(path, "series", "can only be chosen in a folder of DICOM files");
    if (image::is_volume_file(path)) {
      if (fs::file_size(path, error) == 0) throw InputError(path, "", "is empty");
      volume = image::read_volume_file(path, options.component);
    } else if (image::is_dicom_file(path)) {
      volume = image::read_dicom(path, options, between, told);
    } else {
      throw InputError(path, "", "is not a scan format that is known",
                       "give a folder with a DICOM series, or .nrrd, .nii, .nii.gz, .mha, .mhd");
    }
  }
  image::place_volume(path, volume, options.spacing_mm);
  image::check_values(path, volume.data);
  if (notes) notes->insert(notes->end(), told.begin(), told.end());
  return volume;
}

}  // namespace

ImageVolume<float> read_scan(const std::string& path, const ScanReadOptions& options,
                             std::vector<std::string>* notes) {
  return read(path, options, image::Between::kLinear, notes);
}

ImageVolume<float> read_scan(const std::string& path,
                             const std::optional<std::array<double, 3>>& spacing_mm) {
  ScanReadOptions options;
  options.spacing_mm = spacing_mm;
  return read_scan(path, options);
}

ImageVolume<std::uint16_t> read_label_image(const std::string& path, const ScanReadOptions& options,
                                            std::vector<std::string>* notes) {
  const ImageVolume<float> greys = read(path, options, image::Between::kNearest, notes);
  ImageVolume<std::uint16_t> labels;
  labels.size = greys.size;
  labels.spacing = greys.spacing;
  labels.origin = greys.origin;
  labels.direction = greys.direction;
  labels.data.resize(greys.data.size());
  for (std::size_t i = 0; i < greys.data.size(); ++i) {
    const float v = greys.data[i];
    if (!(v >= 0 && v <= 65535 && v == std::floor(v)))
      throw InputError(path, "voxel data",
                       "holds the value " + image::number(v) + ", which is no label",
                       "labels are integers in 0..65535; a grey scan goes without --labels");
    labels.data[i] = static_cast<std::uint16_t>(v);
  }
  return labels;
}

ImageVolume<std::uint16_t> read_label_image(
    const std::string& path, const std::optional<std::array<double, 3>>& spacing_mm) {
  ScanReadOptions options;
  options.spacing_mm = spacing_mm;
  return read_label_image(path, options);
}

std::string sha256_of_scan(const std::string& path, const std::string& series) {
  std::error_code error;
  std::vector<std::string> files;
  if (fs::is_directory(path, error)) {
    files = image::files_of_series(path, series);
  } else {
    const std::string data =
        image::is_volume_file(path) ? image::detached_data_of(path) : std::string();
    if (data.empty()) return sha256_of_file(path);
    files = {path, data};
  }
  Sha256 all;
  for (const auto& file : files) {
    const std::string one = sha256_of_file(file);
    all.update(one.data(), one.size());
  }
  return all.hex();
}

}  // namespace toothprep
