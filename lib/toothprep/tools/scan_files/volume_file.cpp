#include "toothprep/tools/scan_files/volume_file.h"

// All of Eigen stands before ITK, which brings an older copy of it with the same include guards.
#include <itkImageIOBase.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/trial.h"
#include "toothprep/tools/scan_files/byte_stream.h"
#include "toothprep/tools/scan_files/image_checks.h"
#include "toothprep/tools/scan_files/itk_io.h"

namespace toothprep::image {
namespace fs = std::filesystem;
namespace {

// ---- Where the voxels are

struct DataPlace {
  std::string file;          // where the voxels are; empty if that isn't one whole file
  std::uint64_t starts = 0;  // bytes before what is read, be it deflated or not
  std::uint64_t offset = 0;  // bytes of it, inflated, before the voxels
  bool compressed = false;
  bool deflated = false;  // by zlib or gzip
  bool big_endian = false;
  std::optional<itk::IOComponentEnum> type = {};  // if ITK turns the values into another one
  double slope = 1, intercept = 0;
  bool plain = true;  // nothing else has to be known to read the voxels one after the other
};

std::optional<itk::IOComponentEnum> nifti_type(int code) {
  using itk::IOComponentEnum;
  switch (code) {
    case 2:
      return IOComponentEnum::UCHAR;
    case 4:
      return IOComponentEnum::SHORT;
    case 8:
      return IOComponentEnum::INT;
    case 16:
      return IOComponentEnum::FLOAT;
    case 64:
      return IOComponentEnum::DOUBLE;
    case 256:
      return IOComponentEnum::CHAR;
    case 512:
      return IOComponentEnum::USHORT;
    case 768:
      return IOComponentEnum::UINT;
    case 1024:
      return IOComponentEnum::LONGLONG;
    case 1280:
      return IOComponentEnum::ULONGLONG;
    default:
      return {};
  }
}

// NIfTI-1, one file: https://nifti.nimh.nih.gov/pub/dist/src/niftilib/nifti1.h
DataPlace nifti_place(const std::string& path) {
  DataPlace place;
  place.file = path;
  place.compressed = place.deflated = lower(path).ends_with(".gz");
  std::array<char, 348> header{};
  try {
    if (!ByteStream(path, 0, place.deflated).read(0, header.size(), header.data())) {
      place.plain = false;
      return place;
    }
  } catch (const std::runtime_error& e) {
    throw InputError(path, "", e.what());
  }
  std::int32_t size = 0;
  std::memcpy(&size, header.data(), 4);
  const bool swapped = size != 348;
  place.big_endian = swapped != (std::endian::native == std::endian::big);
  const auto number_at = [&]<class T>(std::size_t at, T) {
    std::array<char, sizeof(T)> bytes{};
    std::memcpy(bytes.data(), header.data() + at, sizeof(T));
    if (swapped) std::reverse(bytes.begin(), bytes.end());
    return std::bit_cast<T>(bytes);
  };
  const std::string_view mark(header.data() + 344, 3);
  if (mark != "n+1" && mark != "ni1") throw std::runtime_error("it lacks the mark of NIfTI-1");
  // The library's decomposition of a matrix that isn't finite never ends.
  for (std::size_t at = 256; at < 328; at += 4)
    if (!std::isfinite(number_at(at, 0.0f)))
      throw InputError(path, "orientation", "holds a value that is not a finite number",
                       "the file's header is damaged");
  float offset = number_at(108, 0.0f);
  const float slope = number_at(112, 0.0f), intercept = number_at(116, 0.0f);
  if (offset == 0) offset = 352;  // "where the header and its extensions end", if none is said
  if (!(offset >= 348 && offset < 1e9f && offset == std::floor(offset)))
    throw InputError(path, "vox_offset",
                     "the place of the voxels, byte " + number(offset) + ", can't be one",
                     "the file's header is damaged");
  place.plain = mark == "n+1";
  place.offset = static_cast<std::uint64_t>(offset);
  if (std::isfinite(slope) && slope != 0 && std::isfinite(intercept)) {
    place.slope = slope;
    place.intercept = intercept;
  }
  place.type = nifti_type(number_at(70, std::int16_t{0}));
  place.plain = place.plain && place.type;
  return place;
}

constexpr std::size_t kLongestLine = 4096;  // bytes; only lists of files are as long

// The few header fields that tell where and how the voxels lie; ITK reads them all, but only to
// read all voxels, and some of its readers allocate what the header says and only warn when data is
// short.
DataPlace data_place(const std::string& path, Format format) {
  if (format == Format::kNifti) return nifti_place(path);
  DataPlace place;
  place.file = path;
  std::ifstream in(path, std::ios::binary);
  std::string line;
  bool detached = false;
  for (int n = 0; n < 4096 && std::getline(in, line); ++n) {
    const std::string text = trimmed(line);
    if (format == Format::kNrrd && text.empty()) break;
    const auto colon = text.find(format == Format::kNrrd ? ':' : '=');
    if (colon == std::string::npos || text[0] == '#') continue;
    const std::string key = lower(trimmed(text.substr(0, colon)));
    if (text.size() > kLongestLine)
      throw InputError(path, "line " + std::to_string(n + 1), "is longer than any of such a header",
                       "the file's header is damaged");
    const std::string value = trimmed(text.substr(colon + 1)), low = lower(value);
    if (format == Format::kNrrd) {
      if (key == "encoding") {
        place.compressed = low != "raw";
        place.deflated = low == "gzip" || low == "gz";
        place.plain = place.plain && (low == "raw" || place.deflated);
      }
      if (key == "endian") place.big_endian = low == "big";
      if (key == "line skip" || key == "lineskip" || key == "byte skip" || key == "byteskip")
        place.plain = place.plain && low == "0";
      if (key == "data file" || key == "datafile") detached = true, place.file = value;
    } else {
      if (key == "ndims" && low != "2" && low != "3" && low != "4")
        throw InputError(path, "NDims", "is '" + value.substr(0, 40) + "'",
                         "a scan has three dimensions");
      if (key == "compresseddata") place.compressed = place.deflated = low == "true";
      if (key == "binarydata") place.plain = place.plain && low == "true";
      if (key == "headersize") place.plain = place.plain && low == "0";
      if (key == "elementbyteordermsb" || key == "binarydatabyteordermsb")
        place.big_endian = low == "true";
      if (key == "elementdatafile") {
        if (low != "local") detached = true, place.file = value;
        break;
      }
    }
  }
  if (detached) {
    if (place.file.find_first_of(" %") != std::string::npos ||
        lower(place.file).starts_with("list")) {
      if (format == Format::kMeta)  // MetaIO would make up the voxels of those that aren't there
        throw InputError(path, "ElementDataFile", "names several files, which isn't read",
                         "save the volume as one file, or give the DICOM folder");
      return {};  // left to ITK
    }
    place.file = (fs::path(path).parent_path() / place.file).string();
    std::error_code error;
    if (fs::equivalent(path, place.file, error))
      throw InputError(path, "data file", "is the header itself", "the file's header is damaged");
  } else if (in.good()) {
    place.starts = static_cast<std::uint64_t>(in.tellg());
  } else {
    place.plain = false;  // the header never ends
  }
  return place;
}

void check_data_file(const std::string& path, const DataPlace& place) {
  if (place.file.empty()) return;
  std::error_code error;
  if (!fs::exists(place.file, error))
    throw InputError(path, "data file", "'" + place.file + "' does not exist");
  if (!fs::is_regular_file(place.file, error))
    throw InputError(path, "data file", "'" + place.file + "' is not a regular file");
}

InputError too_few(const std::string& path, double promised, const std::string& there) {
  return InputError(path, "voxel data",
                    "the header promises " + number(promised) + " bytes, the file holds " + there,
                    "the file is truncated or its header is wrong");
}

// Memory is only taken for what the file can hold.
void check_bytes(const std::string& path, const DataPlace& place, double promised) {
  if (place.file.empty()) return;
  std::error_code error;
  const auto size = fs::file_size(place.file, error);
  if (error)
    throw InputError(path, "data file", "'" + place.file + "' can't be read: " + error.message());
  const auto before = place.starts + (place.deflated ? 0 : place.offset);
  const double there = std::max(0.0, static_cast<double>(size) - static_cast<double>(before));
  if (promised > (place.compressed ? there * kMaxDeflateRatio + 1024 : there))
    throw too_few(path, promised, number(there) + (place.compressed ? " (compressed)" : ""));
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

// ---- What ITK makes of a header

constexpr unsigned kHeaderSeconds = 20, kReadSeconds = 600;
constexpr std::size_t kReaderMemory = std::size_t{1} << 30;
constexpr unsigned kMostDimensions = 8;

struct Header {
  bool read = false;
  unsigned dimensions = 0, components = 0;
  std::array<double, kMostDimensions> size;
  std::array<double, 3> spacing, origin;
  std::array<std::array<double, 3>, 3> axes;
  itk::IOComponentEnum type;
};

// Its libraries (MetaIO, the NIfTI library, VNL) crash or hang on some damaged headers, so that it
// only meets them in a child process.
void try_itk(const std::function<void()>& work, unsigned seconds, std::size_t memory) {
  const auto failure = failure_in_trial(
      [&] {
        silence_libraries();
        try {
          work();
        } catch (const itk::ExceptionObject& e) {
          throw std::runtime_error(description(e));
        }
      },
      seconds, memory);
  if (!failure) return;
  throw std::runtime_error(failure->empty() ? "it is damaged" : *failure);
}

Header itk_header(const std::string& path, Format format) {
  const SharedMemory shared(sizeof(Header));
  try_itk(
      [&] {
        const itk::ImageIOBase::Pointer io = io_of(format);
        io->SetFileName(path);
        io->ReadImageInformation();
        Header h;
        h.dimensions = io->GetNumberOfDimensions();
        h.components = io->GetNumberOfComponents();
        h.type = io->GetComponentType();
        for (unsigned a = 0; a < std::min(h.dimensions, kMostDimensions); ++a)
          h.size[a] = static_cast<double>(io->GetDimensions(a));
        for (unsigned a = 0; a < std::min(h.dimensions, 3u); ++a) {
          h.spacing[a] = io->GetSpacing(a);
          h.origin[a] = io->GetOrigin(a);
          const std::vector<double> axis = io->GetDirection(a);
          for (unsigned b = 0; b < std::min<std::size_t>(3, axis.size()); ++b)
            h.axes[a][b] = axis[b];
        }
        h.read = true;
        std::memcpy(shared.data(), &h, sizeof h);
      },
      kHeaderSeconds, kReaderMemory);
  Header header;
  std::memcpy(&header, shared.data(), sizeof header);
  if (!header.read) throw std::runtime_error("no process could be started to read it");
  return header;
}

// A file may hold several grey values at a place: components of a vector, or volumes of a 4-D
// image.
struct Parts {
  std::array<double, 3> size{1, 1, 1};
  int components = 1, volumes = 1;
};

Parts parts_of(const std::string& path, const Header& header) {
  Parts parts;
  parts.components = static_cast<int>(header.components);
  double volumes = 1;
  for (unsigned a = 0; a < header.dimensions; ++a) {
    const double n = a < kMostDimensions ? header.size[a] : 0;
    if (a < 3)
      parts.size[a] = n;
    else if (n != 1 && (a > 3 || parts.components > 1))
      throw InputError(path, "size",
                       "has " + std::to_string(header.dimensions) + " dimensions" +
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

// ---- Values

// Of voxels whose values follow each other as components, all of one kind.
template <class T>
void take(const char* bytes, std::size_t step, bool swapped, std::size_t count, float* values) {
  for (std::size_t i = 0; i < count; ++i) {
    T value;
    const char* from = bytes + i * step * sizeof(T);
    if (swapped) {
      std::array<char, sizeof(T)> turned;
      std::reverse_copy(from, from + sizeof(T), turned.begin());
      value = std::bit_cast<T>(turned);
    } else {
      std::memcpy(&value, from, sizeof(T));
    }
    values[i] = static_cast<float>(value);
  }
}

using Take = void (*)(const char*, std::size_t, bool, std::size_t, float*);

Take take_of(itk::IOComponentEnum type) {
  using itk::IOComponentEnum;
  switch (type) {
    case IOComponentEnum::UCHAR:
      return take<unsigned char>;
    case IOComponentEnum::CHAR:
      return take<signed char>;
    case IOComponentEnum::USHORT:
      return take<unsigned short>;
    case IOComponentEnum::SHORT:
      return take<short>;
    case IOComponentEnum::UINT:
      return take<unsigned int>;
    case IOComponentEnum::INT:
      return take<int>;
    case IOComponentEnum::ULONG:
      return take<unsigned long>;
    case IOComponentEnum::LONG:
      return take<long>;
    case IOComponentEnum::ULONGLONG:
      return take<unsigned long long>;
    case IOComponentEnum::LONGLONG:
      return take<long long>;
    case IOComponentEnum::FLOAT:
      return take<float>;
    case IOComponentEnum::DOUBLE:
      return take<double>;
    default:
      throw std::runtime_error("the voxels' type is not known");
  }
}

// In the file; ITK's LONG is the compiler's.
std::size_t bytes_of(itk::IOComponentEnum type) {
  using itk::IOComponentEnum;
  switch (type) {
    case IOComponentEnum::UCHAR:
    case IOComponentEnum::CHAR:
      return 1;
    case IOComponentEnum::USHORT:
    case IOComponentEnum::SHORT:
      return 2;
    case IOComponentEnum::UINT:
    case IOComponentEnum::INT:
    case IOComponentEnum::FLOAT:
      return 4;
    default:
      return 8;
  }
}

// How the values of one component follow each other.
struct Layout {
  Take take = nullptr;
  std::size_t value_bytes = 0;
  std::size_t first = 0, step = 1;  // values
  std::size_t all = 0;              // values of all components and volumes
};

// What is asked of the file, when it is asked.
class InFile : public ScanSource {
 public:
  InFile(const std::string& path, const ImageFrame& frame, const DataPlace& place,
         const Layout& layout)
      : ScanSource(path, frame),
        place_(place),
        layout_(layout),
        stream_(place.file, place.starts, place.deflated) {}

  void read(int first, int count, float* values) override {
    const Index3 size = frame().size;
    const std::size_t area = static_cast<std::size_t>(size.x()) * size.y();
    // The last voxel of a slice need not be followed by its other components.
    const std::size_t bytes = ((area - 1) * layout_.step + 1) * layout_.value_bytes;
    const auto slice = [&](int k, std::vector<char>& buffer) {
      const auto at = static_cast<std::size_t>(first + k) * area * layout_.step + layout_.first;
      buffer.resize(bytes);
      if (!stream_.read(place_.offset + at * layout_.value_bytes, bytes, buffer.data()))
        throw too_few(path(), static_cast<double>(layout_.all * layout_.value_bytes),
                      std::string("fewer") + (place_.deflated ? " (compressed)" : ""));
    };
    const auto convert = [&](int k, const std::vector<char>& buffer) {
      float* to = values + static_cast<std::size_t>(k) * area;
      const bool swapped = place_.big_endian != (std::endian::native == std::endian::big);
      layout_.take(buffer.data(), layout_.step, swapped, area, to);
      if (place_.slope == 1 && place_.intercept == 0) return;
      for (std::size_t v = 0; v < area; ++v)
        to[v] = static_cast<float>(static_cast<double>(to[v]) * place_.slope + place_.intercept);
    };
    if (place_.deflated) {
      std::vector<std::vector<char>> buffers(static_cast<std::size_t>(count));
      for (int k = 0; k < count; ++k) slice(k, buffers[static_cast<std::size_t>(k)]);
      tbb::parallel_for(0, count, [&](int k) { convert(k, buffers[static_cast<std::size_t>(k)]); });
      if (first + count == size.z() && !stream_.sound())
        throw InputError(path(), "voxel data", "its compressed data is damaged",
                         "copy the file again");
    } else {
      tbb::parallel_for(0, count, [&](int k) {
        std::vector<char> buffer;
        slice(k, buffer);
        convert(k, buffer);
      });
    }
  }

 private:
  DataPlace place_;
  Layout layout_;
  ByteStream stream_;
};

// By ITK, as a whole.
ImageVolume<float> read_whole(const std::string& path, Format format, const ImageFrame& frame,
                              const Layout& layout) {
  const SharedMemory bytes(layout.all * layout.value_bytes);
  try_itk(
      [&] {
        const itk::ImageIOBase::Pointer io = io_of(format);
        io->SetFileName(path);
        io->ReadImageInformation();
        const unsigned dimensions = io->GetNumberOfDimensions();
        itk::ImageIORegion whole(dimensions);
        for (unsigned a = 0; a < dimensions; ++a) {
          whole.SetIndex(a, 0);
          whole.SetSize(a, io->GetDimensions(a));
        }
        io->SetIORegion(whole);
        if (static_cast<std::size_t>(io->GetImageSizeInBytes()) != layout.all * layout.value_bytes)
          throw std::runtime_error("its size isn't what its header says");
        io->Read(bytes.data());
      },
      kReadSeconds, 2 * layout.all * layout.value_bytes + kReaderMemory);
  ImageVolume<float> volume;
  static_cast<ImageFrame&>(volume) = frame;
  volume.data.resize(frame.voxels());
  layout.take(bytes.data() + layout.first * layout.value_bytes, layout.step, false,
              volume.data.size(), volume.data.data());
  return volume;
}

std::unique_ptr<ScanSource> opened(const std::string& path, Format format,
                                   std::optional<int> component,
                                   const std::optional<std::array<double, 3>>& spacing_mm) {
  const DataPlace place = data_place(path, format);
  check_data_file(path, place);
  const Header header = itk_header(path, format);
  const Parts parts = parts_of(path, header);
  const auto part = static_cast<std::size_t>(chosen_part(path, parts, component));
  check_size(path, parts.size);
  ImageFrame frame;
  for (unsigned a = 0; a < 3; ++a) {
    frame.size[a] = static_cast<int>(parts.size[a]);
    frame.spacing[a] = header.spacing[a];
    frame.origin[a] = header.origin[a];
    for (unsigned b = 0; b < 3; ++b) frame.direction(b, a) = header.axes[a][b];
  }
  if (format == Format::kNrrd) {
    const double unit = nrrd_unit_mm(path);
    frame.spacing *= unit;
    frame.origin *= unit;
  }
  const auto value_type = place.plain && place.type ? *place.type : header.type;
  Layout layout;
  layout.take = take_of(value_type);
  layout.value_bytes = bytes_of(value_type);
  layout.step = static_cast<std::size_t>(parts.components);
  layout.first = parts.components > 1 ? part : part * frame.voxels();
  layout.all = frame.voxels() * static_cast<std::size_t>(parts.components) *
               static_cast<std::size_t>(parts.volumes);
  const std::size_t promised = layout.all * layout.value_bytes;
  check_bytes(path, place, static_cast<double>(promised));
  place_volume(path, frame, spacing_mm);
  if (place.plain && !place.file.empty())
    return std::make_unique<InFile>(path, frame, place, layout);
  // Readers take what they get of a stream that ends too early.
  char last = 0;
  if (place.deflated && !place.file.empty() &&
      !ByteStream(place.file, place.starts, true).read(place.offset + promised - 1, 1, &last))
    throw too_few(path, static_cast<double>(promised), "fewer (compressed)");
  return owning_source(read_whole(path, format, frame, layout), path);
}

}  // namespace

bool is_volume_file(const std::string& path) { return format_of(path).has_value(); }

std::string detached_data_of(const std::string& path) {
  const std::string file = data_place(path, format_of(path).value()).file;
  return file == path ? std::string() : file;
}

std::unique_ptr<ScanSource> open_volume_file(
    const std::string& path, std::optional<int> component,
    const std::optional<std::array<double, 3>>& spacing_mm) {
  const Format format = format_of(path).value();
  const auto failed = [&](const std::string& why) {
    return InputError(path, "", std::string("cannot be read as ") + name_of(format) + ": " + why);
  };
  try {
    return opened(path, format, component, spacing_mm);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const Error&) {
    throw;
  } catch (const std::exception& e) {
    throw failed(e.what());
  }
}

}  // namespace toothprep::image
