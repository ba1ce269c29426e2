#include "toothprep/tools/scan_files/volume_file.h"

// All of Eigen stands before ITK, which brings an older copy of it with the same include guards.
#include <itkImageIOBase.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/memory_limit.h"
#include "toothprep/tools/io/trial.h"
#include "toothprep/tools/scan_files/byte_stream.h"
#include "toothprep/tools/scan_files/image_checks.h"
#include "toothprep/tools/scan_files/itk_io.h"
#include "toothprep/tools/scan_files/volume_header.h"

namespace toothprep::image {
namespace {

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
  throw std::runtime_error(failure->text.empty() ? "it is damaged" : failure->text);
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
  if (step == 1 && !swapped) {  // by vectors
    for (std::size_t i = 0; i < count; ++i) {
      T value;
      std::memcpy(&value, bytes + i * sizeof(T), sizeof(T));
      values[i] = static_cast<float>(value);
    }
    return;
  }
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

// The largest magnitude of the type's values, if they are whole numbers that single precision has, too.
double most_of(itk::IOComponentEnum type) {
  using itk::IOComponentEnum;
  switch (type) {
    case IOComponentEnum::UCHAR:
      return 255;
    case IOComponentEnum::CHAR:
      return 128;
    case IOComponentEnum::USHORT:
      return 65535;
    case IOComponentEnum::SHORT:
      return 32768;
    default:
      return std::numeric_limits<double>::infinity();
  }
}

// How the values of one component follow each other.
struct Layout {
  Take take = nullptr;
  std::size_t value_bytes = 0;
  double most = 0;                  // most_of() their type
  std::size_t first = 0, step = 1;  // values
  std::size_t all = 0;              // values of all components and volumes
};

InputError damaged(const std::string& path) {
  return InputError(path, "voxel data", "its compressed data is damaged", "copy the file again");
}

InputError other_length(const std::string& path, const Layout& layout, const std::string& there) {
  return InputError(path, "voxel data",
                    "the header promises " +
                        count_text(static_cast<double>(layout.all * layout.value_bytes)) +
                        " bytes, the file holds " + there + " (compressed)",
                    "the file is damaged or its header is wrong");
}

// The rest of a compressed stream, with its checksum and its length.
void check_stream(const std::string& path, const DataPlace& place, const Layout& layout,
                  ByteStream& stream) {
  switch (stream.read_to_end(place.offset + layout.all * layout.value_bytes)) {
    case ByteStream::State::kWhole:
      return;
    case ByteStream::State::kDamaged:
      throw damaged(path);
    case ByteStream::State::kTooShort:
      throw other_length(path, layout, "fewer");
    case ByteStream::State::kTooLong:
      throw other_length(path, layout, "more");
  }
}

// What is read from the file, and when.
class InFile : public ScanSource {
 public:
  InFile(const std::string& path, const ImageFrame& frame, const DataPlace& place,
         const Layout& layout)
      : ScanSource(path, frame),
        place_(place),
        layout_(layout),
        stream_(place.files[0], place.starts, place.deflated) {}

  void read(int first, int count, float* values) override {
    VoxelRange slices = whole_of(frame());
    slices.first.z() = first;
    slices.last.z() = first + count - 1;
    read_part(slices, values);
  }

  void read_part(const VoxelRange& part, float* values) override {
    const int rows = part.size().y(), slices = part.size().z();
    const std::size_t row = static_cast<std::size_t>(part.size().x());
    const auto place = [&](int k, int j) {
      return values + (static_cast<std::size_t>(k) * rows + j) * row;
    };
    if (place_.deflated) {
      std::vector<std::vector<char>> bytes(static_cast<std::size_t>(slices));
      for (int k = 0; k < slices; ++k)
        read_rows(part, 0, rows, k, bytes[static_cast<std::size_t>(k)]);
      tbb::parallel_for(0, slices, [&](int k) {
        convert_rows(part, rows, bytes[static_cast<std::size_t>(k)], place(k, 0));
      });
    } else {
      // So many at a time that they stay in the processor's cache.
      const int most = static_cast<int>(std::max<std::size_t>(1, kBytesAtOnce / bytes_of_rows(1)));
      const int parts = (rows + most - 1) / most;  // of a slice
      tbb::parallel_for(0, slices * parts, [&](int n) {
        std::vector<char> bytes;
        const int k = n / parts, j = n % parts * most, some = std::min(most, rows - j);
        read_rows(part, j, some, k, bytes);
        convert_rows(part, some, bytes, place(k, j));
      });
    }
  }

  std::size_t voxels_at_once() const override {
    constexpr std::size_t kInCache = std::size_t{1} << 21;  // 8 MB of values
    return place_.deflated ? ScanSource::voxels_at_once() : kInCache;
  }

  double whole_up_to() const override {
    return image::whole_up_to(layout_.most, place_.slope, place_.intercept);
  }

  void check_rest() override { check_stream(path(), place_, layout_, stream_); }

 private:
  static constexpr std::size_t kBytesAtOnce = 1 << 16;

  // Whole rows; the last voxel need not be followed by its other components.
  std::size_t bytes_of_rows(int count) const {
    const auto voxels =
        static_cast<std::size_t>(count) * static_cast<std::size_t>(frame().size.x());
    return ((voxels - 1) * layout_.step + 1) * layout_.value_bytes;
  }

  // Of the part's slice k, from its row j on.
  void read_rows(const VoxelRange& part, int j, int count, int k, std::vector<char>& bytes) {
    const Index3 size = frame().size;
    const std::size_t voxel = (static_cast<std::size_t>(part.first.z() + k) * size.y() +
                               static_cast<std::size_t>(part.first.y() + j)) *
                              size.x();
    bytes.resize(bytes_of_rows(count));
    if (!stream_.read(place_.offset + (voxel * layout_.step + layout_.first) * layout_.value_bytes,
                      bytes.size(), bytes.data()))
      throw stream_.damaged() ? damaged(path()) : other_length(path(), layout_, "fewer");
  }

  void convert_rows(const VoxelRange& part, int count, const std::vector<char>& bytes,
                    float* values) const {
    const bool swapped = place_.big_endian != (std::endian::native == std::endian::big);
    const auto whole = static_cast<std::size_t>(frame().size.x()),
               row = static_cast<std::size_t>(part.size().x()),
               skipped = static_cast<std::size_t>(part.first.x());
    for (std::size_t j = 0; j < static_cast<std::size_t>(count); ++j) {
      float* to = values + j * row;
      layout_.take(bytes.data() + (j * whole + skipped) * layout_.step * layout_.value_bytes,
                   layout_.step, swapped, row, to);
      if (place_.slope == 1 && place_.intercept == 0) continue;
      for (std::size_t v = 0; v < row; ++v)
        to[v] = static_cast<float>(static_cast<double>(to[v]) * place_.slope + place_.intercept);
    }
  }

  DataPlace place_;
  Layout layout_;
  ByteStream stream_;
};

// By ITK, as a whole.
ImageVolume<float> read_whole(const std::string& path, Format format, const ImageFrame& frame,
                              const Layout& layout) {
  const std::size_t all = layout.all * layout.value_bytes;
  check_voxels(path, frame.size);
  require_memory(
      path, "size", 2 * static_cast<double>(all) + 4.0 * static_cast<double>(frame.voxels()),
      "save the volume uncompressed and as one file, of which a part can be read (--roi)");
  const SharedMemory bytes(all);
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
        if (static_cast<std::size_t>(io->GetImageSizeInBytes()) != all)
          throw std::runtime_error("its size isn't what its header says");
        io->Read(bytes.data());
      },
      kReadSeconds, 2 * all + kReaderMemory);
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
  check_data_files(path, place);
  if (!spacing_mm) check_spacing(path, format);
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
  layout.most = most_of(value_type);
  layout.step = static_cast<std::size_t>(parts.components);
  layout.first = parts.components > 1 ? part : part * frame.voxels();
  layout.all = frame.voxels() * static_cast<std::size_t>(parts.components) *
               static_cast<std::size_t>(parts.volumes);
  check_bytes(path, place, static_cast<double>(layout.all * layout.value_bytes));
  place_volume(path, frame, spacing_mm);
  if (place.plain) return std::make_unique<InFile>(path, frame, place, layout);
  // ITK's readers take what they get of a stream that is damaged or ends too early.
  if (place.deflated && place.files.size() == 1) {
    ByteStream stream(place.files[0], place.starts, true);
    check_stream(path, place, layout, stream);
  }
  return owning_source(read_whole(path, format, frame, layout), path);
}

}  // namespace

bool is_volume_file(const std::string& path) { return format_of(path).has_value(); }

std::vector<std::string> detached_data_of(const std::string& path) {
  std::vector<std::string> files = data_place(path, format_of(path).value()).files;
  if (files == std::vector{path}) files.clear();
  return files;
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
