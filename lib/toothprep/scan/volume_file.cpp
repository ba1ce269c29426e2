#include "toothprep/scan/volume_file.h"

// All of Eigen stands before ITK, which brings an older copy of it with the same include guards.
#include <itkImageFileReader.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "toothprep/core/errors.h"
#include "toothprep/scan/image_checks.h"
#include "toothprep/scan/itk_io.h"

namespace toothprep::image {
namespace fs = std::filesystem;
namespace {

// ---- What a header promises, against the bytes that are there.

struct DataPlace {
  std::string file;   // where the voxels are; empty if that isn't one whole file
  double offset = 0;  // bytes before them
  bool compressed = false;
  bool deflated = false;  // by zlib or gzip
};

// ITK's readers allocate what the header says and some only warn when data is short, so the few
// header fields that tell where the data lies are read here as well.
DataPlace data_place(const std::string& path, Format format) {
  DataPlace place{path};
  if (format == Format::kNifti) {
    place.compressed = place.deflated = lower(path).ends_with(".gz");
    if (!place.compressed) place.offset = 348;
    return place;
  }
  std::ifstream in(path, std::ios::binary);
  std::string line;
  bool detached = false;
  for (int n = 0; n < 4096 && std::getline(in, line); ++n) {
    const std::string text = trimmed(line);
    if (format == Format::kNrrd && text.empty()) break;
    const auto colon = text.find(format == Format::kNrrd ? ':' : '=');
    if (colon == std::string::npos || text[0] == '#') continue;
    const std::string key = lower(trimmed(text.substr(0, colon)));
    const std::string value = trimmed(text.substr(colon + 1));
    if (format == Format::kNrrd) {
      if (key == "encoding") {
        place.compressed = lower(value) != "raw";
        place.deflated = lower(value) == "gzip" || lower(value) == "gz";
      }
      if (key == "data file" || key == "datafile") detached = true, place.file = value;
    } else {
      if (key == "compresseddata") place.compressed = place.deflated = lower(value) == "true";
      if (key == "elementdatafile") {
        if (lower(value) != "local") detached = true, place.file = value;
        break;
      }
    }
  }
  if (detached) {
    // A list or a pattern of files is left to ITK.
    if (place.file.find_first_of(" %") != std::string::npos || lower(place.file) == "list")
      return {};
    place.file = (fs::path(path).parent_path() / place.file).string();
  } else {
    place.offset = static_cast<double>(in.tellg());
  }
  return place;
}

void check_data_file(const std::string& path, Format format) {
  const DataPlace place = data_place(path, format);
  if (!place.file.empty() && !fs::exists(place.file))
    throw InputError(path, "data file", "'" + place.file + "' does not exist");
}

void check_bytes(const std::string& path, Format format, const itk::ImageIOBase& io,
                 double voxels) {
  const DataPlace place = data_place(path, format);
  if (place.file.empty()) return;
  std::error_code error;
  const auto size = fs::file_size(place.file, error);
  if (error)
    throw InputError(path, "data file", "'" + place.file + "' can't be read: " + error.message());
  const double there = std::max(0.0, static_cast<double>(size) - place.offset);
  const double promised = voxels * static_cast<double>(io.GetComponentSize());
  const bool possible =
      place.compressed ? promised <= there * kMaxDeflateRatio + 1024 : promised <= there;
  if (!possible || (place.deflated && !inflates_to(place.file, place.offset, promised)))
    throw InputError(path, "voxel data",
                     "the header promises " + number(promised) + " bytes, the file holds " +
                         (possible ? "fewer" : number(there)) +
                         (place.compressed ? " (compressed)" : ""),
                     "the file is truncated or its header is wrong");
}

using FloatImage = itk::Image<float, 3>;

ImageVolume<float> volume_of(const FloatImage& image) {
  ImageVolume<float> volume;
  const auto size = image.GetLargestPossibleRegion().GetSize();
  for (int a = 0; a < 3; ++a) {
    volume.size[a] = static_cast<int>(size[a]);
    volume.spacing[a] = image.GetSpacing()[a];
    volume.origin[a] = image.GetOrigin()[a];
    for (int b = 0; b < 3; ++b) volume.direction(a, b) = image.GetDirection()(a, b);
  }
  const float* values = image.GetBufferPointer();
  volume.data.assign(values, values + size[0] * size[1] * size[2]);
  return volume;
}

// NRRD says its unit in `space units`, which ITK does not apply.
double nrrd_unit_mm(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::string line;
  for (int n = 0; n < 4096 && std::getline(in, line) && !trimmed(line).empty(); ++n) {
    if (lower(line).rfind("space units:", 0) != 0) continue;
    const auto from = line.find('"'), to = line.find('"', from + 1);
    if (from == std::string::npos || to == std::string::npos) return 1;
    const std::string unit = lower(trimmed(line.substr(from + 1, to - from - 1)));
    if (unit == "mm" || unit.empty()) return 1;
    if (unit == "um" || unit == "\xc2\xb5m" || unit == "\xce\xbcm" || unit == "microns" ||
        unit == "micron" || unit == "micrometer")
      return 1e-3;
    if (unit == "cm") return 10;
    if (unit == "m") return 1000;
    throw InputError(path, "space units", "the unit '" + unit + "' is not known",
                     "use mm, um, cm or m");
  }
  return 1;
}

ImageVolume<float> read_scalar(const std::string& path, const itk::ImageIOBase::Pointer& io) {
  const auto reader = itk::ImageFileReader<FloatImage>::New();
  reader->SetImageIO(io);
  reader->SetFileName(path);
  reader->Update();
  return volume_of(*reader->GetOutput());
}

// A file may hold several grey values at a place: components of a vector, or volumes of a 4-D
// image.
struct Parts {
  std::array<double, 3> size{1, 1, 1};
  int components = 1, volumes = 1;
};

Parts parts_of(const std::string& path, const itk::ImageIOBase& io) {
  Parts parts;
  parts.components = static_cast<int>(io.GetNumberOfComponents());
  double volumes = 1;
  for (unsigned a = 0; a < io.GetNumberOfDimensions(); ++a) {
    const auto n = static_cast<double>(io.GetDimensions(a));
    if (a < 3)
      parts.size[a] = n;
    else if (n != 1 && (a > 3 || parts.components > 1))
      throw InputError(path, "size",
                       "has " + std::to_string(io.GetNumberOfDimensions()) + " dimensions" +
                           (parts.components > 1 ? " and several components per voxel" : ""),
                       "a scan has three");
    else
      volumes *= n;
  }
  if (!(volumes >= 1 && volumes < 1e6 && parts.components >= 1))
    throw InputError(path, "size", "states " + number(volumes) + " volumes",
                     "a scan has three dimensions");
  parts.volumes = static_cast<int>(volumes);
  return parts;
}

// Counted from zero.
int chosen_part(const std::string& path, const Parts& parts, std::optional<int> component) {
  const int count = parts.components * parts.volumes;
  const std::string has =
      parts.components > 1 ? "has " + std::to_string(count) + " components per voxel"
      : parts.volumes > 1  ? "has four dimensions (" + std::to_string(count) + " volumes)"
                           : "has one grey value per voxel";
  if (component) {
    if (*component < 1 || *component > count)
      throw InputError(path, "voxel data",
                       has + ", so there is no component " + std::to_string(*component),
                       count > 1 ? "the first is 1" : "only 1 can be chosen");
    return *component - 1;
  }
  if (count > 1)
    throw InputError(path, "voxel data", has,
                     "a scan has one grey value per voxel; choose one with --component (1 .. " +
                         std::to_string(count) + ")");
  return 0;
}

template <class T>
void take(const std::vector<char>& bytes, std::size_t first, std::size_t step,
          std::vector<float>& values) {
  for (std::size_t i = 0; i < values.size(); ++i) {
    T value;
    std::memcpy(&value, bytes.data() + (first + i * step) * sizeof(T), sizeof(T));
    values[i] = static_cast<float>(value);
  }
}

ImageVolume<float> read_part(itk::ImageIOBase& io, const Parts& parts, int part) {
  const unsigned dimensions = io.GetNumberOfDimensions();
  itk::ImageIORegion whole(dimensions);
  for (unsigned a = 0; a < dimensions; ++a) {
    whole.SetIndex(a, 0);
    whole.SetSize(a, io.GetDimensions(a));
  }
  io.SetIORegion(whole);
  std::vector<char> bytes(static_cast<std::size_t>(io.GetImageSizeInBytes()));
  io.Read(bytes.data());

  ImageVolume<float> volume;
  for (unsigned a = 0; a < 3; ++a) {
    volume.size[a] = static_cast<int>(parts.size[a]);
    volume.spacing[a] = io.GetSpacing(a);
    volume.origin[a] = io.GetOrigin(a);
    const std::vector<double> axis = io.GetDirection(a);
    for (unsigned b = 0; b < 3; ++b) volume.direction(b, a) = axis[b];
  }
  const auto voxels = static_cast<std::size_t>(voxel_count(volume.size));
  volume.data.resize(voxels);
  const auto at = static_cast<std::size_t>(part);
  const std::size_t first = parts.components > 1 ? at : at * voxels;
  const auto step = static_cast<std::size_t>(parts.components);
  using itk::IOComponentEnum;
  switch (io.GetComponentType()) {
    case IOComponentEnum::UCHAR:
      take<unsigned char>(bytes, first, step, volume.data);
      break;
    case IOComponentEnum::CHAR:
      take<signed char>(bytes, first, step, volume.data);
      break;
    case IOComponentEnum::USHORT:
      take<unsigned short>(bytes, first, step, volume.data);
      break;
    case IOComponentEnum::SHORT:
      take<short>(bytes, first, step, volume.data);
      break;
    case IOComponentEnum::UINT:
      take<unsigned int>(bytes, first, step, volume.data);
      break;
    case IOComponentEnum::INT:
      take<int>(bytes, first, step, volume.data);
      break;
    case IOComponentEnum::ULONG:
      take<unsigned long>(bytes, first, step, volume.data);
      break;
    case IOComponentEnum::LONG:
      take<long>(bytes, first, step, volume.data);
      break;
    case IOComponentEnum::ULONGLONG:
      take<unsigned long long>(bytes, first, step, volume.data);
      break;
    case IOComponentEnum::LONGLONG:
      take<long long>(bytes, first, step, volume.data);
      break;
    case IOComponentEnum::FLOAT:
      take<float>(bytes, first, step, volume.data);
      break;
    case IOComponentEnum::DOUBLE:
      take<double>(bytes, first, step, volume.data);
      break;
    default:
      throw std::runtime_error("the voxels' type is not known");
  }
  return volume;
}

}  // namespace

bool is_volume_file(const std::string& path) { return format_of(path).has_value(); }

std::string detached_data_of(const std::string& path) {
  const std::string file = data_place(path, format_of(path).value()).file;
  return file == path ? std::string() : file;
}

ImageVolume<float> read_volume_file(const std::string& path, std::optional<int> component) {
  const Format format = format_of(path).value();
  check_data_file(path, format);
  const itk::ImageIOBase::Pointer io = io_of(format);
  try {
    const Silence silence;
    io->SetFileName(path);
    io->ReadImageInformation();
    const Parts parts = parts_of(path, *io);
    const int part = chosen_part(path, parts, component);
    check_size(path, parts.size);
    check_bytes(path, format, *io,
                parts.size[0] * parts.size[1] * parts.size[2] * parts.components * parts.volumes);
    ImageVolume<float> volume =
        parts.components * parts.volumes == 1 ? read_scalar(path, io) : read_part(*io, parts, part);
    if (format == Format::kNrrd) {
      const double unit = nrrd_unit_mm(path);
      volume.spacing *= unit;
      volume.origin *= unit;
    }
    return volume;
  } catch (const itk::ExceptionObject& e) {
    throw InputError(path, "",
                     std::string("cannot be read as ") + name_of(format) + ": " + description(e));
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const Error&) {
    throw;
  } catch (const std::exception& e) {
    throw InputError(path, "",
                     std::string("cannot be read as ") + name_of(format) + ": " + e.what());
  }
}

}  // namespace toothprep::image
