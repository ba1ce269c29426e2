#include "toothprep/tools/scan_files/volume_header.h"

#include <fmt/printf.h>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <sstream>
#include <stdexcept>
#include <string_view>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/regular_file.h"
#include "toothprep/tools/io/input_file.h"
#include "toothprep/tools/scan_files/byte_stream.h"
#include "toothprep/tools/scan_files/image_checks.h"

namespace toothprep::image {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kLongestHeader = 1 << 22;  // bytes; only lists of files are nearly as long
constexpr std::size_t kLongestLine = 4096;       // bytes
constexpr int kMostLines = 4096;
constexpr std::size_t kMostFiles = 100000;
const std::string kDamaged = "the file's header is damaged";

// ---- NIfTI-1, one file: https://nifti.nimh.nih.gov/pub/dist/src/niftilib/nifti1.h

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

struct NiftiHeader {
  std::array<char, 348> bytes{};
  bool swapped = false;

  template <class T>
  T at(std::size_t offset) const {
    std::array<char, sizeof(T)> value{};
    std::memcpy(value.data(), bytes.data() + offset, sizeof(T));
    if (swapped) std::reverse(value.begin(), value.end());
    return std::bit_cast<T>(value);
  }
  std::string_view mark() const { return {bytes.data() + 344, 3}; }
};

// Nothing if the file is shorter than a header.
std::optional<NiftiHeader> nifti_header(const std::string& path) {
  NiftiHeader header;
  const bool deflated = lower(path).ends_with(".gz");
  if (!ByteStream(path, 0, deflated).read(0, header.bytes.size(), header.bytes.data())) return {};
  header.swapped = header.at<std::int32_t>(0) != 348;
  if (header.mark() != "n+1" && header.mark() != "ni1")
    throw std::runtime_error("it lacks the mark of NIfTI-1");
  return header;
}

DataPlace nifti_place(const std::string& path) {
  DataPlace place;
  place.files = {path};
  place.compressed = place.deflated = lower(path).ends_with(".gz");
  const auto header = nifti_header(path);
  if (!header) throw std::runtime_error("it holds no whole header, compressed as its name says");
  place.big_endian = header->swapped != (std::endian::native == std::endian::big);
  // The library's decomposition of a matrix that isn't finite never ends.
  for (std::size_t at = 256; at < 328; at += 4)
    if (!std::isfinite(header->at<float>(at)))
      throw InputError(path, "orientation", "holds a value that is not a finite number", kDamaged);
  float offset = header->at<float>(108);
  if (offset == 0) offset = 352;  // "where the header and its extensions end", if none is said
  if (!(offset >= 348 && offset < 1e9f && offset == std::floor(offset)))
    throw InputError(path, "vox_offset",
                     "the place of the voxels, byte " + number(offset) + ", can't be one",
                     kDamaged);
  place.offset = static_cast<std::uint64_t>(offset);
  const float slope = header->at<float>(112), intercept = header->at<float>(116);
  if (std::isfinite(slope) && slope != 0 && std::isfinite(intercept)) {
    place.slope = slope;
    place.intercept = intercept;
  }
  place.type = nifti_type(header->at<std::int16_t>(70));
  place.plain = header->mark() == "n+1" && place.type;
  return place;
}

// ---- Headers of text

struct Field {
  std::string key, value;  // the key in small letters
};

struct TextHeader {
  std::vector<Field> fields;
  bool ended = false;     // by a blank line (NRRD) or ElementDataFile (MetaImage)
  std::uint64_t end = 0;  // bytes up to there
  std::string rest;       // the text that follows, as far as it was read

  // Empty if there is none.
  std::string value_of(const std::string& key) const {
    for (const Field& field : fields)
      if (field.key == key) return field.value;
    return {};
  }
};

TextHeader text_header(const std::string& path, Format format) {
  const InputFile file(path);
  std::string text(std::min<std::uint64_t>(file.size(), kLongestHeader), '\0');
  text.resize(file.read(0, text.size(), text.data()));
  if (format == Format::kNrrd && !text.starts_with("NRRD"))
    throw std::runtime_error("it does not begin with 'NRRD'");
  TextHeader header;
  std::size_t at = 0;
  for (int n = 1; n <= kMostLines && at < text.size() && !header.ended; ++n) {
    const std::size_t line_end = std::min(text.find('\n', at), text.size());
    const std::string whole = text.substr(at, line_end - at), line = trimmed(whole);
    at = std::min(line_end + 1, text.size());
    const auto colon = line.find(format == Format::kNrrd ? ':' : '=');
    if (format == Format::kNrrd && line.empty()) header.ended = true;
    // ITK ends at a zero byte, or takes the next line for the value of this one.
    const bool text_line = std::none_of(whole.begin(), whole.end(), [](char c) {
      return static_cast<unsigned char>(c) < ' ' && c != '\t' && c != '\r';
    });
    if (!text_line || (format == Format::kMeta && !line.empty() && line[0] != '#' &&
                       line.find_first_of("=:") == std::string::npos))
      throw InputError(path, "line " + std::to_string(n), "is no line of such a header", kDamaged);
    if (colon == std::string::npos || line[0] == '#') continue;
    if (line.size() > kLongestLine)
      throw InputError(path, "line " + std::to_string(n), "is longer than any of such a header",
                       kDamaged);
    header.fields.push_back(
        {lower(trimmed(line.substr(0, colon))), trimmed(line.substr(colon + 1))});
    if (format == Format::kMeta && header.fields.back().key == "elementdatafile")
      header.ended = true;
    if (format == Format::kNrrd && header.fields.back().key.starts_with("data") &&
        lower(header.fields.back().value).starts_with("list"))
      break;  // the list follows at once
  }
  header.end = at;
  header.rest = text.substr(at);
  return header;
}

// The files that a NRRD header names: one, a list after the header, or a pattern with numbers. All
// but the first are read by ITK.
std::vector<std::string> nrrd_files(const std::string& path, const std::string& value,
                                    const std::string& rest) {
  std::vector<std::string> names;
  if (lower(value).starts_with("list")) {
    std::istringstream lines(rest);
    for (std::string line; std::getline(lines, line) && names.size() <= kMostFiles;)
      if (!trimmed(line).empty()) names.push_back(trimmed(line));
  } else if (value.find('%') != std::string::npos) {
    std::istringstream words(value);
    std::string pattern;
    long first = 0, last = 0, step = 0;
    const auto percent = value.find('%');
    const auto kind = value.find_first_not_of("0123456789", percent + 1);
    if (!(words >> pattern >> first >> last >> step) || step == 0 || (last - first) / step < 0 ||
        kind == std::string::npos || value[kind] != 'd' || kind - percent > 3 ||
        value.find('%', kind) != std::string::npos)
      throw InputError(path, "data file", "'" + value + "' is no pattern of files", kDamaged);
    for (long n = first; step > 0 ? n <= last : n >= last; n += step) {
      names.push_back(pattern.substr(0, percent) +
                      fmt::sprintf(pattern.substr(percent, kind - percent + 1), n) +
                      pattern.substr(kind + 1));
      if (names.size() > kMostFiles) break;
    }
  } else {
    names.push_back(value);
  }
  if (names.empty() || names.size() > kMostFiles)
    throw InputError(path, "data file", "names " + std::to_string(names.size()) + " files",
                     kDamaged);
  return names;
}

// Where they are, seen from here.
std::vector<std::string> beside(const std::string& path, std::vector<std::string> names) {
  for (std::string& name : names) {
    name = (fs::path(path).parent_path() / name).string();
    std::error_code error;
    if (fs::equivalent(path, name, error))
      throw InputError(path, "data file", "is the header itself", kDamaged);
  }
  return names;
}

void place_in_or_beside(const std::string& path, const TextHeader& header,
                        const std::vector<std::string>& names, DataPlace& place) {
  if (!names.empty()) {
    place.files = beside(path, names);
    if (names.size() > 1) place.plain = false;
    return;
  }
  if (!header.ended) throw std::runtime_error("its header has no end");
  place.files = {path};
  place.starts = header.end;
}

DataPlace nrrd_place(const std::string& path) {
  const TextHeader header = text_header(path, Format::kNrrd);
  DataPlace place;
  std::vector<std::string> names;
  for (const auto& [key, value] : header.fields) {
    const std::string low = lower(value);
    if (key == "encoding") {
      place.compressed = low != "raw";
      place.deflated = low == "gzip" || low == "gz";
      place.plain = place.plain && (low == "raw" || place.deflated);
    }
    if (key == "endian") place.big_endian = low == "big";
    if (key == "line skip" || key == "lineskip" || key == "byte skip" || key == "byteskip")
      place.plain = place.plain && low == "0";
    if (key == "data file" || key == "datafile") {
      names = nrrd_files(path, value, header.rest);
      if (lower(value).starts_with("list")) place.plain = false;
    }
  }
  place_in_or_beside(path, header, names, place);
  return place;
}

DataPlace meta_place(const std::string& path) {
  const TextHeader header = text_header(path, Format::kMeta);
  DataPlace place;
  std::vector<std::string> names;
  for (const auto& [key, value] : header.fields) {
    const std::string low = lower(value);
    if (key == "ndims" && low != "2" && low != "3" && low != "4")
      throw InputError(path, "NDims", "is '" + value.substr(0, 40) + "'",
                       "a scan has three dimensions");
    if (key == "compresseddata") place.compressed = place.deflated = low == "true";
    if (key == "binarydata") place.plain = place.plain && low == "true";
    if (key == "headersize") place.plain = place.plain && low == "0";
    if (key == "elementbyteordermsb" || key == "binarydatabyteordermsb")
      place.big_endian = low == "true";
    if (key == "elementdatafile" && low != "local") names = {value};
  }
  // MetaIO would make up the voxels of those that aren't there.
  if (!names.empty() &&
      (names[0].find_first_of(" %") != std::string::npos || lower(names[0]).starts_with("list")))
    throw InputError(path, "ElementDataFile", "names several files, which isn't read",
                     "save the volume as one file, or give the DICOM folder");
  place_in_or_beside(path, header, names, place);
  return place;
}

// ---- Voxel sizes as they are stated

const std::string kCorrect = "correct that line of the header";

[[noreturn]] void refuse_spacing(
    const std::string& path, const std::string& field, int axis, const std::string& value,
    const std::string& remedy = "give the true voxel size with --spacing-mm") {
  throw InputError(
      path, field,
      "states '" + value.substr(0, 40) + "' as the voxel size along axis " + std::to_string(axis),
      remedy);
}

// NaN for what is no number.
double number_of(const std::string& text) {
  double value = 0;
  const char* first = text.data();
  const char* last = first + text.size();
  if (text.size() > 1 && *first == '+') ++first;
  const auto [end, error] = std::from_chars(first, last, value);
  return error == std::errc() && end == last ? value : std::nan("");
}

bool is_word_for_number(const std::string& text) {
  return lower(text) == "nan" || !std::isnan(number_of(text));
}

bool is_length(double value) { return std::isfinite(value) && value > 0; }

// A value per axis of the array, as text, and as the length that it states.
struct Stated {
  std::vector<std::string> text;
  std::vector<double> length;
};

Stated stated_numbers(const std::string& value) {
  Stated stated;
  std::istringstream words(value);
  for (std::string word; words >> word;) {
    stated.text.push_back(word);
    stated.length.push_back(number_of(word));
  }
  return stated;
}

// "(x,y,z) none (x,y,z) ...": lengths of the vectors.
Stated stated_vectors(const std::string& value) {
  Stated stated;
  for (std::size_t at = 0; (at = value.find_first_not_of(" \t", at)) != std::string::npos;) {
    const std::size_t end = value[at] == '('
                                ? std::min(value.find(')', at), value.size() - 1) + 1
                                : std::min(value.find_first_of(" \t(", at), value.size());
    std::string text = value.substr(at, end - at);
    at = end;
    stated.text.push_back(text);
    double square = text[0] == '(' ? 0 : std::nan("");
    std::replace_if(
        text.begin(), text.end(), [](char c) { return c == '(' || c == ')' || c == ','; }, ' ');
    for (const double component : stated_numbers(text).length) square += component * component;
    stated.length.push_back(std::sqrt(square));
  }
  return stated;
}

// ITK's readers take the beginning of a damaged number for the number.
void check_places(const std::string& path, const TextHeader& header,
                  std::initializer_list<const char*> fields) {
  for (const char* field : fields) {
    std::string value = header.value_of(lower(field));
    std::replace_if(
        value.begin(), value.end(), [](char c) { return c == '(' || c == ')' || c == ','; }, ' ');
    const Stated stated = stated_numbers(value);
    for (std::size_t n = 0; n < stated.text.size(); ++n)
      if (!std::isfinite(stated.length[n]))
        throw InputError(path, field, "holds '" + stated.text[n] + "' where a number has to be",
                         kCorrect);
  }
}

void check_nrrd_spacing(const std::string& path) {
  const TextHeader header = text_header(path, Format::kNrrd);
  check_places(path, header, {"sizes", "space origin"});
  for (const std::string field : {"spacings", "space directions"}) {
    const std::string value = header.value_of(field);
    if (value.empty()) continue;
    const Stated stated = field == "spacings" ? stated_numbers(value) : stated_vectors(value);
    // Of four axes the first or the last may be that of components or volumes, without a size.
    std::size_t first = 0, count = stated.text.size();
    if (count == 4 && !is_length(stated.length[0]))
      first = 1;
    else if (count == 4 && !is_length(stated.length[3]))
      count = 3;
    for (std::size_t a = first; a < count; ++a)
      if (!is_length(stated.length[a])) {
        const int axis = static_cast<int>(a);
        // ITK's reader stops at others, whatever spacing is to stand for them.
        const bool replaceable = field == "spacings" && stated.length[a] != 0 &&
                                 !std::isinf(stated.length[a]) &&
                                 is_word_for_number(stated.text[a]);
        if (replaceable) refuse_spacing(path, field, axis, stated.text[a]);
        refuse_spacing(path, field, axis, stated.text[a], kCorrect);
      }
  }
}

void check_meta_spacing(const std::string& path) {
  const TextHeader header = text_header(path, Format::kMeta);
  check_places(
      path, header,
      {"DimSize", "Offset", "Position", "Origin", "TransformMatrix", "Rotation", "Orientation"});
  for (const std::string field : {"ElementSpacing", "ElementSize"}) {
    const std::string value = header.value_of(lower(field));
    if (value.empty()) continue;
    const Stated stated = stated_numbers(value);
    for (std::size_t a = 0; a < std::min<std::size_t>(3, stated.text.size()); ++a) {
      if (is_length(stated.length[a])) continue;
      const int axis = static_cast<int>(a);
      // MetaIO stops at others.
      if (std::isfinite(stated.length[a])) refuse_spacing(path, field, axis, stated.text[a]);
      refuse_spacing(path, field, axis, stated.text[a], kCorrect);
    }
    return;  // the size counts where there is no spacing
  }
}

void check_nifti_spacing(const std::string& path) {
  const auto header = nifti_header(path);
  if (!header) return;
  constexpr double kConflict = 0.01;  // programs round the one or the other
  const int dimensions = std::clamp<int>(header->at<std::int16_t>(40), 1, 3);
  for (int a = 0; a < dimensions; ++a) {
    const std::string field = "pixdim[" + std::to_string(a + 1) + "]";
    const double size = header->at<float>(80 + 4 * static_cast<std::size_t>(a));
    if (!is_length(size)) refuse_spacing(path, field, a, number(size));
    if (header->at<std::int16_t>(254) <= 0) continue;  // the sform isn't in use
    double square = 0;
    for (std::size_t row = 0; row < 3; ++row) {
      const double m = header->at<float>(280 + 16 * row + 4 * static_cast<std::size_t>(a));
      square += m * m;
    }
    const double column = std::sqrt(square);
    if (!(std::abs(column - size) <= kConflict * size))
      throw InputError(path, field,
                       "is " + number(size) + ", but the sform's column " + std::to_string(a + 1) +
                           " is " + number(column) + " long: two voxel sizes along one axis",
                       "give the true one with --spacing-mm");
  }
}

}  // namespace

DataPlace data_place(const std::string& path, Format format) {
  switch (format) {
    case Format::kNrrd:
      return nrrd_place(path);
    case Format::kNifti:
      return nifti_place(path);
    case Format::kMeta:
      break;
  }
  return meta_place(path);
}

void check_data_files(const std::string& path, const DataPlace& place) {
  for (const std::string& file : place.files) try {
      regular_file_size(file);
    } catch (const InputError& e) {
      throw InputError(path, "data file", e.what());
    }
}

void check_bytes(const std::string& path, const DataPlace& place, double promised) {
  double there = 0;
  for (const std::string& file : place.files) there += static_cast<double>(regular_file_size(file));
  there -= static_cast<double>(place.starts + (place.deflated ? 0 : place.offset));
  there = std::max(there, 0.0);
  const bool too_few = promised > (place.compressed ? there * kMaxDeflateRatio + 1024 : there);
  const bool too_many = place.plain && !place.compressed && there > promised;
  if (too_few || too_many)
    throw InputError(path, "voxel data",
                     "the header promises " + count_text(promised) + " bytes, the file holds " +
                         count_text(there) + (place.compressed ? " (compressed)" : ""),
                     too_few ? "the file is truncated or its header is wrong"
                             : "its header is wrong, or something else was appended");
}

void check_spacing(const std::string& path, Format format) {
  switch (format) {
    case Format::kNrrd:
      return check_nrrd_spacing(path);
    case Format::kNifti:
      return check_nifti_spacing(path);
    case Format::kMeta:
      return check_meta_spacing(path);
  }
}

double nrrd_unit_mm(const std::string& path) {
  const std::string line = text_header(path, Format::kNrrd).value_of("space units");
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

}  // namespace toothprep::image
