#include <Eigen/Dense>

#include "toothprep/tools/scan_files/image_file.h"

// All of Eigen stands before ITK, which brings an older copy of it with the same include guards.
#include <itkGDCMImageIO.h>
#include <itkImageFileWriter.h>
#include <itkImportImageFilter.h>
#include <itkMetaDataObject.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/tools/scan_files/image_checks.h"
#include "toothprep/tools/scan_files/itk_io.h"

namespace toothprep {
namespace fs = std::filesystem;
using namespace image;
namespace {

template <class T>
typename itk::ImportImageFilter<T, 3>::Pointer imported(const ImageVolume<T>& image,
                                                        int first_slice, int slices) {
  using Import = itk::ImportImageFilter<T, 3>;
  const auto import = Import::New();
  typename Import::SizeType size;
  size[0] = static_cast<std::size_t>(image.size.x());
  size[1] = static_cast<std::size_t>(image.size.y());
  size[2] = static_cast<std::size_t>(slices);
  typename Import::IndexType start;
  start.Fill(0);
  import->SetRegion(typename Import::RegionType(start, size));
  typename Import::SpacingType spacing;
  typename Import::OriginType origin;
  typename Import::DirectionType direction;
  const Vec3 first = image.to_world(Vec3(0, 0, first_slice));
  for (int a = 0; a < 3; ++a) {
    spacing[a] = image.spacing[a];
    origin[a] = first[a];
    for (int b = 0; b < 3; ++b) direction(a, b) = image.direction(a, b);
  }
  import->SetSpacing(spacing);
  import->SetOrigin(origin);
  import->SetDirection(direction);
  const std::size_t area = size[0] * size[1];
  // ITK asks for a mutable pointer but only reads.
  import->SetImportPointer(
      const_cast<T*>(image.data.data()) + static_cast<std::size_t>(first_slice) * area,
      area * static_cast<std::size_t>(slices), false);
  return import;
}

template <class T>
void write_volume(const ImageVolume<T>& image, const std::string& path) {
  silence_libraries();
  // An output under a temporary name may have lost the ".nii" before its ".gz".
  const std::string low = lower(path);
  const bool bare_gz = low.ends_with(".gz") && !low.ends_with(".nii.gz");
  const std::string target = bare_gz ? path + ".nii.gz" : path;
  const auto format = format_of(target);
  if (!format || low.ends_with(".mhd") || low.ends_with(".nhdr"))
    throw InputError(path, "", "is not an image format that can be written",
                     "use .nrrd, .nii, .nii.gz or .mha");
  if (image.data.size() != static_cast<std::size_t>(voxel_count(image.size)) || image.data.empty())
    throw Error(path + ": the image to be written has no voxels");
  try {
    const auto import = imported(image, 0, image.size.z());
    const auto writer = itk::ImageFileWriter<itk::Image<T, 3>>::New();
    writer->SetInput(import->GetOutput());
    writer->SetImageIO(io_of(*format));
    writer->SetFileName(target);
    writer->SetUseCompression(!low.ends_with(".nii"));
    writer->Update();
  } catch (const itk::ExceptionObject& e) {
    throw Error(path + ": cannot be written: " + description(e));
  }
  std::error_code error;
  if (bare_gz) fs::rename(target, path, error);
  if (error) throw Error(path + ": cannot be written: " + error.message());
}

// A UID of the "2.25." kind: a UUID (made of a hash, so version 5) as one decimal number.
std::string uid_of(const std::string& seed) {
  Sha256 hash;
  hash.update(seed.data(), seed.size());
  const std::string hex = hash.hex();
  std::array<unsigned, 16> bytes{};
  for (std::size_t i = 0; i < 16; ++i)
    bytes[i] = static_cast<unsigned>(std::stoul(hex.substr(2 * i, 2), nullptr, 16));
  bytes[6] = (bytes[6] & 0x0fu) | 0x50u;
  bytes[8] = (bytes[8] & 0x3fu) | 0x80u;
  std::string digits;
  while (std::any_of(bytes.begin(), bytes.end(), [](unsigned b) { return b != 0; })) {
    unsigned rest = 0;
    for (auto& b : bytes) {  // long division by ten
      const unsigned value = rest * 256 + b;
      b = value / 10;
      rest = value % 10;
    }
    digits.insert(digits.begin(), static_cast<char>('0' + rest));
  }
  return "2.25." + digits;
}

}  // namespace

void write_image(const ImageVolume<std::int16_t>& image, const std::string& path) {
  write_volume(image, path);
}
void write_image(const ImageVolume<std::uint8_t>& image, const std::string& path) {
  write_volume(image, path);
}

void write_dicom_series(const ImageVolume<std::int16_t>& image, const std::string& folder) {
  silence_libraries();
  if (image.data.size() != static_cast<std::size_t>(voxel_count(image.size)) || image.data.empty())
    throw Error(folder + ": the image to be written has no voxels");
  Sha256 content;
  content.update(image.size.data(), sizeof(int) * 3);
  content.update(image.spacing.data(), sizeof(double) * 3);
  content.update(image.origin.data(), sizeof(double) * 3);
  content.update(image.direction.data(), sizeof(double) * 9);
  content.update(image.data.data(), image.data.size() * sizeof(std::int16_t));
  const std::string seed = content.hex();

  for (int k = 0; k < image.size.z(); ++k) {
    std::array<char, 32> name{};
    std::snprintf(name.data(), name.size(), "slice_%04d.dcm", k + 1);
    const auto import = imported(image, k, 1);
    const auto io = itk::GDCMImageIO::New();
    io->KeepOriginalUIDOn();
    io->UseCompressionOff();
    itk::MetaDataDictionary tags;
    const auto set = [&tags](const char* tag, const std::string& value) {
      itk::EncapsulateMetaData<std::string>(tags, tag, value);
    };
    set("0008|0008", "DERIVED\\SECONDARY\\AXIAL");
    set("0008|0016", "1.2.840.10008.5.1.4.1.1.2");  // CT Image Storage
    set("0008|0018", uid_of(seed + "/instance/" + std::to_string(k)));
    set("0008|0020", "20000101");  // dates are constants: the same image gives the same bytes
    set("0008|0030", "000000");
    set("0008|0060", "CT");
    set("0008|0070", "toothprep");
    set("0008|103e", "toothprep");
    set("0010|0010", "toothprep");
    set("0010|0020", "toothprep");
    set("0018|0050", number(image.spacing.z()));
    set("0018|5100", "HFS");
    set("0020|000d", uid_of(seed + "/study"));
    set("0020|000e", uid_of(seed + "/series"));
    set("0020|0011", "1");
    set("0020|0013", std::to_string(k + 1));
    set("0020|0052", uid_of(seed + "/frame"));
    set("0028|0004", "MONOCHROME2");
    set("0028|1052", "0");
    set("0028|1053", "1");
    set("0028|1054", "US");
    import->UpdateLargestPossibleRegion();
    import->GetOutput()->SetMetaDataDictionary(tags);
    io->SetMetaDataDictionary(tags);
    try {
      const auto writer = itk::ImageFileWriter<itk::Image<std::int16_t, 3>>::New();
      writer->SetInput(import->GetOutput());
      writer->SetImageIO(io);
      writer->SetFileName((fs::path(folder) / name.data()).string());
      writer->Update();
    } catch (const itk::ExceptionObject& e) {
      throw Error(folder + ": " + name.data() + " cannot be written: " + description(e));
    }
  }
}

}  // namespace toothprep
