// All of Eigen stands before ITK, which brings an older copy of it with the same include guards.
#include "toothprep/scan/image_file.h"

#include <Eigen/Dense>

// Eigen (through image_volume.h) stands before ITK, whose own copy of Eigen shares its include
// guards.
#include <fcntl.h>
#include <gdcmDirectory.h>
#include <gdcmReader.h>
#include <gdcmScanner.h>
#include <gdcmTrace.h>
#include <itkGDCMImageIO.h>
#include <itkImageFileReader.h>
#include <itkImageFileWriter.h>
#include <itkImportImageFilter.h>
#include <itkMetaDataObject.h>
#include <itkMetaImageIO.h>
#include <itkNiftiImageIO.h>
#include <itkNrrdImageIO.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <set>
#include <sstream>
#include <type_traits>
#include <vector>

#include "toothprep/core/errors.h"
#include "toothprep/core/hash.h"

namespace toothprep {
namespace fs = std::filesystem;
namespace {

constexpr double kMaxVoxels = 2147483648.0;            // 2^31
constexpr double kMinSpacing = 1e-3, kMaxSpacing = 5;  // mm
constexpr double kMaxDeflateRatio = 1032;  // deflate's own limit; all our formats use it

// ITK and GDCM talk on stderr by themselves; a failure here is one exception and nothing else.
void silence_libraries() {
  itk::Object::GlobalWarningDisplayOff();
  gdcm::Trace::DebugOff();
  gdcm::Trace::WarningOff();
  gdcm::Trace::ErrorOff();
  static std::ofstream nowhere("/dev/null");
  gdcm::Trace::SetStream(nowhere);
}

double voxel_count(const Index3& size) { return size.cast<double>().prod(); }

// MetaIO and the NIfTI library print their complaints unconditionally. While one of these lives,
// what is printed goes nowhere; the failure itself comes as an exception or is found by the checks
// below.
class Silence {
 public:
  Silence() {
    silence_libraries();
    flush();
    const int nowhere = open("/dev/null", O_WRONLY);
    for (int i = 0; i < 2; ++i) {
      saved_[i] = dup(i + 1);
      if (nowhere >= 0 && saved_[i] >= 0) dup2(nowhere, i + 1);
    }
    if (nowhere >= 0) close(nowhere);
  }
  ~Silence() {
    flush();
    for (int i = 0; i < 2; ++i)
      if (saved_[i] >= 0) {
        dup2(saved_[i], i + 1);
        close(saved_[i]);
      }
  }
  Silence(const Silence&) = delete;
  Silence& operator=(const Silence&) = delete;

 private:
  static void flush() {
    std::cout.flush();
    std::cerr.flush();
    std::fflush(nullptr);
  }
  std::array<int, 2> saved_{};  // stdout, stderr
};

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

std::string trimmed(const std::string& text) {
  const auto first = text.find_first_not_of(" \t\r\n\0");
  if (first == std::string::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t\r\n\0") - first + 1);
}

std::string number(double value) {
  std::ostringstream text;
  text << value;
  return text.str();
}

enum class Format { kNrrd, kNifti, kMeta };

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

// The readers take what they get of a deflated stream that ends too early. This reads it to its
// end.
bool inflates_to(const DataPlace& place, double promised) {
  std::ifstream in(place.file, std::ios::binary);
  in.seekg(static_cast<std::streamoff>(place.offset));
  z_stream stream{};
  if (inflateInit2(&stream, 15 + 32) != Z_OK) return false;  // zlib or gzip, by its header
  std::vector<char> packed(1 << 16), plain(1 << 18);
  double total = 0;
  int status = Z_OK;
  const auto fill = [&] {
    in.read(packed.data(), static_cast<std::streamsize>(packed.size()));
    stream.next_in = reinterpret_cast<Bytef*>(packed.data());
    stream.avail_in = static_cast<uInt>(in.gcount());
    return stream.avail_in > 0;
  };
  while (total < promised && (stream.avail_in > 0 || fill())) {
    stream.next_out = reinterpret_cast<Bytef*>(plain.data());
    stream.avail_out = static_cast<uInt>(plain.size());
    status = inflate(&stream, Z_NO_FLUSH);
    total += static_cast<double>(plain.size() - stream.avail_out);
    if (status == Z_STREAM_END)
      inflateReset(&stream);  // gzip files may have several members
    else if (status != Z_OK)
      break;
  }
  inflateEnd(&stream);
  return total >= promised;
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
  if (!possible || (place.deflated && !inflates_to(place, promised)))
    throw InputError(path, "voxel data",
                     "the header promises " + number(promised) + " bytes, the file holds " +
                         (possible ? "fewer" : number(there)) +
                         (place.compressed ? " (compressed)" : ""),
                     "the file is truncated or its header is wrong");
}

// ---- What every volume must satisfy, wherever it came from.

void check_size(const std::string& path, const std::array<double, 3>& size) {
  const std::string text = number(size[0]) + " x " + number(size[1]) + " x " + number(size[2]);
  for (const double n : size)
    if (!(n >= 2))
      throw InputError(path, "size", text + " voxels is not a volume",
                       "a scan needs three dimensions");
  if (size[0] * size[1] * size[2] > kMaxVoxels)
    throw InputError(path, "size", text + " voxels is more than 2^31", "crop or coarsen the scan");
}

template <class T>
void place_volume(const std::string& path, ImageVolume<T>& volume,
                  const std::optional<std::array<double, 3>>& spacing_mm) {
  if (spacing_mm) {
    const Vec3 given((*spacing_mm)[0], (*spacing_mm)[1], (*spacing_mm)[2]);
    // The origin is so many voxels from the frame's zero along the image's axes; that count stays.
    const Vec3 voxels =
        (volume.direction.transpose() * volume.origin).cwiseQuotient(volume.spacing);
    volume.origin = volume.direction * given.cwiseProduct(voxels);
    volume.spacing = given;
  }
  for (int axis = 0; axis < 3; ++axis)
    if (!(volume.spacing[axis] >= kMinSpacing && volume.spacing[axis] <= kMaxSpacing))
      throw InputError(path, "spacing",
                       number(volume.spacing[axis]) + " mm along axis " + std::to_string(axis) +
                           " is outside 0.001 .. 5 mm",
                       "give the voxel size with --spacing-mm");
  if (!volume.origin.allFinite() || !volume.direction.allFinite() ||
      (volume.direction.transpose() * volume.direction - Mat3::Identity()).norm() > 1e-3)
    throw InputError(path, "orientation", "the image axes are not orthogonal unit vectors",
                     "resample the scan to a rectangular grid");
}

void check_values(const std::string& path, const std::vector<float>& values) {
  const auto bad =
      std::count_if(values.begin(), values.end(), [](float v) { return !std::isfinite(v); });
  if (bad > 0)
    throw InputError(path, "voxel data",
                     std::to_string(bad) + " of " + std::to_string(values.size()) +
                         " values are not finite numbers",
                     "replace them by the grey value of the surroundings");
}

// The heart of an ITK message: without the class and its address; one line (of NRRD's nested ones
// the last, which is the cause).
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

ImageVolume<float> read_file(const std::string& path, Format format) {
  check_data_file(path, format);
  const itk::ImageIOBase::Pointer io = io_of(format);
  try {
    const Silence silence;
    io->SetFileName(path);
    io->ReadImageInformation();
    if (io->GetNumberOfComponents() != 1)
      throw InputError(
          path, "voxel data",
          "has " + std::to_string(io->GetNumberOfComponents()) + " components per voxel",
          "a scan has one grey value per voxel");
    std::array<double, 3> size{1, 1, 1};
    for (unsigned a = 0; a < io->GetNumberOfDimensions(); ++a) {
      const auto n = static_cast<double>(io->GetDimensions(a));
      if (a < 3)
        size[a] = n;
      else if (n != 1)
        throw InputError(path, "size",
                         "has " + std::to_string(io->GetNumberOfDimensions()) + " dimensions",
                         "a scan has three");
    }
    check_size(path, size);
    check_bytes(path, format, *io, size[0] * size[1] * size[2]);
    const auto reader = itk::ImageFileReader<FloatImage>::New();
    reader->SetImageIO(io);
    reader->SetFileName(path);
    reader->Update();
    ImageVolume<float> volume = volume_of(*reader->GetOutput());
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

// ---- DICOM

const gdcm::Tag kSeriesUid(0x0020, 0x000e), kSeriesDescription(0x0008, 0x103e),
    kPosition(0x0020, 0x0032), kOrientation(0x0020, 0x0037), kRows(0x0028, 0x0010),
    kColumns(0x0028, 0x0011), kPixelSpacing(0x0028, 0x0030), kFrames(0x0028, 0x0008),
    kSamples(0x0028, 0x0002);

std::vector<double> numbers(const std::string& text) {  // DICOM's backslash-separated decimals
  std::vector<double> values;
  std::istringstream in(text);
  std::string part;
  while (std::getline(in, part, '\\')) {
    try {
      values.push_back(std::stod(part));
    } catch (const std::exception&) {
      return {};
    }
  }
  return values;
}

struct Slice {
  std::string file;
  Vec3 position;
  double along = 0;  // mm, of the position along the slice normal
};

struct Series {
  std::vector<Slice> slices;  // ordered
  Mat3 direction;
  Vec3 spacing;
  int columns = 0, rows = 0;
};

Series find_series(const std::string& folder) {
  silence_libraries();
  gdcm::Directory directory;
  directory.Load(folder, false);
  std::vector<std::string> files = directory.GetFilenames();
  std::sort(files.begin(), files.end());
  gdcm::Scanner scanner;
  for (const auto& tag : {kSeriesUid, kSeriesDescription, kPosition, kOrientation, kRows, kColumns,
                          kPixelSpacing, kFrames, kSamples})
    scanner.AddTag(tag);
  if (files.empty() || !scanner.Scan(files))
    throw InputError(folder, "", "holds no DICOM slices",
                     "give the folder with the .dcm files of one series");
  const auto value = [&](const std::string& file, const gdcm::Tag& tag) {
    const char* text = scanner.GetValue(file.c_str(), tag);
    return text ? trimmed(text) : std::string();
  };

  std::map<std::string, std::vector<std::string>> by_series;
  for (const auto& file : files)  // DICOMDIR, reports and the like have no rows
    if (scanner.IsKey(file.c_str()) && !value(file, kRows).empty())
      by_series[value(file, kSeriesUid)].push_back(file);
  if (by_series.empty())
    throw InputError(folder, "", "holds no DICOM slices",
                     "give the folder with the .dcm files of one series");
  if (by_series.size() > 1) {
    std::string list;
    for (const auto& [uid, members] : by_series)
      list += (list.empty() ? "'" : ", '") + value(members.front(), kSeriesDescription) + "' " +
              uid + " (" + std::to_string(members.size()) + " slices)";
    throw InputError(folder, "", "holds " + std::to_string(by_series.size()) + " series: " + list,
                     "keep each series in a folder of its own");
  }

  const auto& members = by_series.begin()->second;
  Series series;
  Vec3 normal = Vec3::Zero();
  for (const auto& file : members) {
    const auto name = fs::path(file).filename().string();
    const auto position = numbers(value(file, kPosition)),
               orientation = numbers(value(file, kOrientation)),
               pixel = numbers(value(file, kPixelSpacing)), rows = numbers(value(file, kRows)),
               columns = numbers(value(file, kColumns)), frames = numbers(value(file, kFrames)),
               samples = numbers(value(file, kSamples));
    if (!frames.empty() && frames[0] > 1)
      throw InputError(folder, name, "is a multi-frame file",
                       "export the series with one slice a file, or as NRRD or NIfTI");
    if (position.size() != 3 || orientation.size() != 6 || pixel.size() != 2 || rows.size() != 1 ||
        columns.size() != 1)
      throw InputError(
          folder, name,
          "lacks a position, orientation or pixel spacing (tags 0020,0032 0020,0037 0028,0030)",
          "export the series again, or as NRRD or NIfTI");
    if (!samples.empty() && samples[0] != 1)
      throw InputError(folder, name, "is a colour image", "a scan has one grey value per voxel");
    const Vec3 x(orientation[0], orientation[1], orientation[2]);
    const Vec3 y(orientation[3], orientation[4], orientation[5]);
    Mat3 direction;
    direction << x, y, x.cross(y);
    // PixelSpacing is (between rows, between columns).
    const Vec3 spacing(pixel[1], pixel[0], 1);
    if (series.slices.empty()) {
      series.direction = direction;
      series.spacing = spacing;
      series.columns = static_cast<int>(columns[0]);
      series.rows = static_cast<int>(rows[0]);
      normal = direction.col(2);
    } else if ((direction - series.direction).norm() > 1e-3 ||
               (spacing - series.spacing).norm() > 1e-4 * spacing.norm() ||
               static_cast<int>(columns[0]) != series.columns ||
               static_cast<int>(rows[0]) != series.rows) {
      throw InputError(folder, name,
                       "differs from the other slices in size, pixel spacing or orientation",
                       "keep only the axial slices of the scan in the folder");
    }
    Slice slice{file, Vec3(position[0], position[1], position[2]), 0};
    slice.along = normal.dot(slice.position);
    series.slices.push_back(slice);
  }
  std::sort(series.slices.begin(), series.slices.end(),
            [](const Slice& a, const Slice& b) { return a.along < b.along; });
  const std::size_t n = series.slices.size();
  check_size(folder, {static_cast<double>(series.columns), static_cast<double>(series.rows),
                      static_cast<double>(n)});

  std::vector<double> gaps;
  for (std::size_t i = 1; i < n; ++i)
    gaps.push_back(series.slices[i].along - series.slices[i - 1].along);
  std::vector<double> ordered = gaps;
  std::nth_element(ordered.begin(),
                   ordered.begin() + static_cast<std::ptrdiff_t>(ordered.size() / 2),
                   ordered.end());
  const double gap = ordered[ordered.size() / 2];
  for (std::size_t i = 1; i < n; ++i) {
    const std::string between = fs::path(series.slices[i - 1].file).filename().string() + " and " +
                                fs::path(series.slices[i].file).filename().string();
    if (gaps[i - 1] < 1e-4)
      throw InputError(folder, between, "lie at the same position",
                       "keep one of each slice in the folder");
    if (std::abs(gaps[i - 1] - gap) > std::max(0.02 * gap, 2e-3))
      throw InputError(
          folder, between,
          "are " + number(gaps[i - 1]) + " mm apart, the other slices " + number(gap) + " mm",
          "slices are missing or irregular; resample the series to even spacing");
    const Vec3 step = series.slices[i].position - series.slices[i - 1].position;
    if ((step - normal * gaps[i - 1]).norm() > std::max(0.02 * gap, 2e-3))
      throw InputError(folder, between, "are shifted sideways (a tilted gantry?)",
                       "resample the series to a rectangular grid");
  }
  series.spacing[2] =
      (series.slices.back().along - series.slices.front().along) / static_cast<double>(n - 1);
  return series;
}

// Whether the pixel data of an uncompressed slice is all there: GDCM takes what it gets.
bool pixels_complete(const std::string& file) {
  const gdcm::Tag pixels(0x7fe0, 0x0010);
  gdcm::Reader reader;
  reader.SetFileName(file.c_str());
  if (!reader.ReadUpToTag(pixels)) return false;
  const auto& syntax = reader.GetFile().GetHeader().GetDataSetTransferSyntax();
  if (syntax == gdcm::TransferSyntax::ExplicitVRBigEndian || syntax.IsEncapsulated() ||
      syntax == gdcm::TransferSyntax::DeflatedExplicitVRLittleEndian)
    return true;  // there GDCM's decoder notices
  const gdcm::DataSet& data = reader.GetFile().GetDataSet();
  if (!data.FindDataElement(pixels)) return false;
  const auto length = static_cast<std::uint32_t>(data.GetDataElement(pixels).GetVL());
  // The element's place: its tag, in explicit syntax its kind and two bytes, then that length.
  std::ifstream in(file, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  const std::string tag("\xe0\x7f\x10\x00", 4);
  for (auto o = bytes.find(tag); o != std::string::npos; o = bytes.find(tag, o + 1)) {
    const bool named = o + 12 <= bytes.size() && bytes[o + 4] == 'O';
    const std::size_t at = o + (named ? 8 : 4);
    if (at + 4 > bytes.size()) return false;
    std::uint32_t stated = 0;
    for (std::size_t b = 0; b < 4; ++b)
      stated |= static_cast<std::uint32_t>(static_cast<unsigned char>(bytes[at + b])) << (8 * b);
    if (stated == length) return at + 4 + length <= bytes.size();
  }
  return true;
}

ImageVolume<float> read_series(const std::string& folder) {
  const Silence silence;
  const Series series = find_series(folder);
  ImageVolume<float> volume;
  volume.size = Index3(series.columns, series.rows, static_cast<int>(series.slices.size()));
  volume.spacing = series.spacing;
  volume.direction = series.direction;
  volume.origin = series.slices.front().position;
  const std::size_t area = static_cast<std::size_t>(series.columns) * series.rows;
  double bytes = 0;
  for (const auto& slice : series.slices) {
    std::error_code error;
    bytes += static_cast<double>(fs::file_size(slice.file, error));
  }
  if (static_cast<double>(area) * static_cast<double>(series.slices.size()) >
      bytes * kMaxDeflateRatio)
    throw InputError(folder, "voxel data",
                     "the headers promise far more voxels than the files hold",
                     "the files are truncated or their headers are wrong");
  volume.data.resize(area * series.slices.size());
  for (std::size_t k = 0; k < series.slices.size(); ++k) {
    const std::string name = fs::path(series.slices[k].file).filename().string();
    if (!pixels_complete(series.slices[k].file))
      throw InputError(folder, name, "its pixel data is not complete", "copy the file again");
    try {
      const auto reader = itk::ImageFileReader<FloatImage>::New();
      reader->SetImageIO(itk::GDCMImageIO::New());
      reader->SetFileName(series.slices[k].file);
      reader->Update();
      const auto region = reader->GetOutput()->GetLargestPossibleRegion();
      if (region.GetNumberOfPixels() != area)
        throw InputError(folder, name, "does not hold one slice of the size that it states");
      const float* values = reader->GetOutput()->GetBufferPointer();
      std::copy(values, values + area, volume.data.begin() + static_cast<std::ptrdiff_t>(k * area));
    } catch (const itk::ExceptionObject& e) {
      throw InputError(folder, name, "cannot be read as a DICOM slice: " + description(e));
    }
  }
  return volume;
}

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

ImageVolume<float> read_scan(const std::string& path,
                             const std::optional<std::array<double, 3>>& spacing_mm) {
  silence_libraries();
  std::error_code error;
  const auto status = fs::status(path, error);
  if (!fs::exists(status)) throw InputError(path, "", "does not exist");
  ImageVolume<float> volume;
  if (fs::is_directory(status)) {
    volume = read_series(path);
  } else {
    const auto format = format_of(path);
    if (!format) {
      std::ifstream in(path, std::ios::binary);
      std::array<char, 132> head{};
      in.read(head.data(), head.size());
      if (std::string(head.data() + 128, 4) == "DICM")
        throw InputError(path, "", "is one DICOM file", "give the folder that holds the series");
      throw InputError(path, "", "is not a scan format that is known",
                       "give a folder with a DICOM series, or .nrrd, .nii, .nii.gz, .mha, .mhd");
    }
    if (!std::ifstream(path, std::ios::binary)) throw InputError(path, "", "cannot be read");
    if (fs::file_size(path, error) == 0) throw InputError(path, "", "is empty");
    volume = read_file(path, *format);
  }
  place_volume(path, volume, spacing_mm);
  check_values(path, volume.data);
  return volume;
}

ImageVolume<std::uint16_t> read_label_image(
    const std::string& path, const std::optional<std::array<double, 3>>& spacing_mm) {
  const ImageVolume<float> read = read_scan(path, spacing_mm);
  ImageVolume<std::uint16_t> labels;
  labels.size = read.size;
  labels.spacing = read.spacing;
  labels.origin = read.origin;
  labels.direction = read.direction;
  labels.data.resize(read.data.size());
  for (std::size_t i = 0; i < read.data.size(); ++i) {
    const float v = read.data[i];
    if (!(v >= 0 && v <= 65535 && v == std::floor(v)))
      throw InputError(path, "voxel data", "holds the value " + number(v) + ", which is no label",
                       "labels are integers in 0..65535; a grey scan goes without --labels");
    labels.data[i] = static_cast<std::uint16_t>(v);
  }
  return labels;
}

std::string sha256_of_scan(const std::string& path) {
  std::error_code error;
  if (!fs::is_directory(path, error)) return sha256_of_file(path);
  Sha256 all;
  for (const auto& slice : find_series(path).slices) {
    const std::string one = sha256_of_file(slice.file);
    all.update(one.data(), one.size());
  }
  return all.hex();
}

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
