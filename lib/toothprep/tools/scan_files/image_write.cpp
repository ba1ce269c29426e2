#include <Eigen/Dense>

#include "toothprep/tools/scan_files/image_file.h"

// All of Eigen stands before ITK, which brings an older copy of it with the same include guards.
#include <fmt/format.h>
#include <itkGDCMImageIO.h>
#include <itkImageFileReader.h>
#include <itkImageFileWriter.h>
#include <itkImportImageFilter.h>
#include <itkMetaDataObject.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>
#include <functional>
#include <new>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/tools/io/input_file.h"
#include "toothprep/tools/io/trial.h"
#include "toothprep/tools/io/write_file.h"
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

// ITK does not always say that the disk is full, and GDCM aborts the program: they write in a
// child process, which reads what it wrote and compares.
void write_in_trial(const std::string& path, std::size_t bytes,
                    const std::function<void()>& write) {
  silence_libraries();
  constexpr std::size_t kLibraries = std::size_t{4} << 30, kBytesPerSecond = 2'000'000;
  const auto seconds = static_cast<unsigned>(60 + bytes / kBytesPerSecond);
  const SharedMemory done(1);
  const auto work = [&] {
    write();
    *done.data() = 1;
  };
  const auto failure = failure_in_trial(work, seconds, 4 * bytes + kLibraries);
  if (*done.data() != 1)
    throw Error(path + ": cannot be written: " + why_not_written(path, 0) +
                (failure && !failure->text.empty() ? " (" + failure->text + ")" : ""));
}

template <class T>
void check_written(const ImageVolume<T>& image, int first_slice, int slices, itk::ImageIOBase* io,
                   const std::string& path) {
  const auto reader = itk::ImageFileReader<itk::Image<T, 3>>::New();
  reader->SetImageIO(io);
  reader->SetFileName(path);
  reader->Update();
  const auto size = reader->GetOutput()->GetBufferedRegion().GetSize();
  const auto area = static_cast<std::size_t>(image.size.x()) * image.size.y();
  if (size[0] * size[1] != area || size[2] != static_cast<std::size_t>(slices) ||
      std::memcmp(reader->GetOutput()->GetBufferPointer(),
                  image.data.data() + static_cast<std::size_t>(first_slice) * area,
                  area * static_cast<std::size_t>(slices) * sizeof(T)) != 0)
    throw Error("read back, it is not the same");
}

// The compressed stream at the end of the file is whole up to its checksum, at which ITK's reader
// does not look.
void check_stream(const std::string& path, const std::string& before) {
  const std::string bytes = bytes_of_file(path);
  const auto found = bytes.find(before);
  if (found == std::string::npos) throw Error("its header is not complete");
  std::size_t at = found + before.size();
  z_stream stream{};
  if (inflateInit2(&stream, 15 + 32) != Z_OK) throw std::bad_alloc();  // gzip or zlib
  std::vector<unsigned char> ignored(1 << 20);
  int status = Z_OK;
  while (status == Z_OK && at < bytes.size()) {
    const auto count = static_cast<unsigned>(std::min<std::size_t>(bytes.size() - at, 1 << 20));
    stream.next_in = reinterpret_cast<unsigned char*>(const_cast<char*>(bytes.data() + at));
    stream.avail_in = count;
    do {
      stream.next_out = ignored.data();
      stream.avail_out = static_cast<unsigned>(ignored.size());
      status = inflate(&stream, Z_NO_FLUSH);
    } while (status == Z_OK && stream.avail_out == 0);
    at += count - stream.avail_in;
    if (status == Z_BUF_ERROR) status = Z_OK;  // wants more
  }
  inflateEnd(&stream);
  if (status != Z_STREAM_END || at != bytes.size()) throw Error("its end is missing");
}

template <class T>
void write_volume(const ImageVolume<T>& image, const std::string& path) {
  const std::string low = lower(path);
  const auto format = format_of(path);
  if (!format || low.ends_with(".mhd") || low.ends_with(".nhdr"))
    throw InputError(path, "", "is not an image format that can be written",
                     "use .nrrd, .nii, .nii.gz or .mha");
  if (image.data.size() != static_cast<std::size_t>(voxel_count(image.size)) || image.data.empty())
    throw Error(path + ": the image to be written has no voxels");
  write_in_trial(path, image.data.size() * sizeof(T), [&] {
    try {
      const auto import = imported(image, 0, image.size.z());
      const auto writer = itk::ImageFileWriter<itk::Image<T, 3>>::New();
      writer->SetInput(import->GetOutput());
      writer->SetImageIO(io_of(*format));
      writer->SetFileName(path);
      writer->SetUseCompression(!low.ends_with(".nii"));
      writer->Update();
      check_written(image, 0, image.size.z(), io_of(*format), path);
      if (low.ends_with(".gz")) check_stream(path, "");
      if (low.ends_with(".nrrd")) check_stream(path, "\n\n");
      if (low.ends_with(".mha")) check_stream(path, "ElementDataFile = LOCAL\n");
    } catch (const itk::ExceptionObject& e) {
      throw Error(description(e));
    }
  });
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

// One slice as a CT Image Storage file.
void write_slice(const ImageVolume<std::int16_t>& image, int k, const std::string& seed,
                 const std::string& path) {
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
  const auto writer = itk::ImageFileWriter<itk::Image<std::int16_t, 3>>::New();
  writer->SetInput(import->GetOutput());
  writer->SetImageIO(io);
  writer->SetFileName(path);
  writer->Update();
  check_written(image, k, 1, itk::GDCMImageIO::New(), path);
}

}  // namespace

void write_image(const ImageVolume<std::int16_t>& image, const std::string& path) {
  write_volume(image, path);
}
void write_image(const ImageVolume<std::uint8_t>& image, const std::string& path) {
  write_volume(image, path);
}

void write_dicom_series(const ImageVolume<std::int16_t>& image, const std::string& folder) {
  if (image.data.size() != static_cast<std::size_t>(voxel_count(image.size)) || image.data.empty())
    throw Error(folder + ": the image to be written has no voxels");
  Sha256 content;
  content.update(image.size.data(), sizeof(int) * 3);
  content.update(image.spacing.data(), sizeof(double) * 3);
  content.update(image.origin.data(), sizeof(double) * 3);
  content.update(image.direction.data(), sizeof(double) * 9);
  content.update(image.data.data(), image.data.size() * sizeof(std::int16_t));
  const std::string seed = content.hex();

  write_in_trial(folder, image.data.size() * sizeof(std::int16_t), [&] {
    for (int k = 0; k < image.size.z(); ++k) {
      const std::string name = fmt::format("slice_{:04d}.dcm", k + 1);
      try {
        write_slice(image, k, seed, (fs::path(folder) / name).string());
      } catch (const itk::ExceptionObject& e) {
        throw Error(name + ": " + description(e));
      }
    }
  });
}

}  // namespace toothprep
