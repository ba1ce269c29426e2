#include "toothprep/tools/recordings/device_log.h"

#include <fmt/format.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <fstream>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/input_file.h"
#include "toothprep/tools/io/memory_limit.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {
namespace {

constexpr std::size_t kMostWords = 32, kLongestWord = 16;
constexpr const char* kButtons = "BUTTONS";

// The endings of the names of a word's numbers; none for a word that isn't a log's.
std::vector<std::string_view> parts_of(std::string_view word) {
  if (word.starts_with("RAW_")) word.remove_prefix(4);
  if (word == "POSITION" || word == "VELOCITY" || word == "FORCE" || word == "TORQUE")
    return {"_X", "_Y", "_Z"};
  if (word == "ORIENTATION") return {"_AXIS_X", "_AXIS_Y", "_AXIS_Z", "_ANGLE"};
  if (word == "TIME" || word == kButtons || word == "TIMESTAMP") return {""};
  return {};
}

// The words up to the second NUL in a row; `end`: behind it.
std::vector<std::string_view> header_words(std::string_view bytes, const std::string& path,
                                           std::size_t& end) {
  std::vector<std::string_view> words;
  for (end = 0; words.size() <= kMostWords;) {
    const std::size_t nul = bytes.substr(end, kLongestWord + 1).find('\0');
    if (nul == std::string_view::npos) break;
    const std::string_view word = bytes.substr(end, nul);
    end += nul + 1;
    if (word.empty()) return words;
    if (parts_of(word).empty()) break;
    words.push_back(word);
  }
  throw InputError(path, "header", "is not that of a device log of H3D or HAPI",
                   "is the file complete?");
}

template <class T>
T number_at(const char* bytes) {
  static_assert(std::endian::native == std::endian::little);
  T value;
  std::memcpy(&value, bytes, sizeof(T));
  return value;
}

// Times of a log begin near 0 and never go back.
void check_times(const RecordedTable& table, const std::string& path) {
  for (std::size_t c = 0; c < table.names.size(); ++c) {
    if (table.names[c] != "TIME") continue;
    double last = 0;
    for (const double t : table.columns[c]) {
      if (!(t >= last && t < 1e7))
        throw InputError(path, "TIME", fmt::format("{:g} s follows {:g} s", t, last),
                         "only logs of HAPI's usual build, with doubles, are read");
      last = t;
    }
  }
}

}  // namespace

std::optional<std::vector<std::string>> device_log_names(
    const std::vector<std::string_view>& words) {
  std::vector<std::string> names;
  for (const std::string_view word : words) {
    const std::vector<std::string_view> parts = parts_of(word);
    if (parts.empty()) return {};
    for (const std::string_view part : parts)
      names.push_back(std::string(word) + std::string(part));
  }
  return names.size() > words.size() ? std::optional(names) : std::nullopt;
}

void set_device_log_conventions(RecordedTable& table) {
  table.kind = "device log of H3D or HAPI";
  table.conventions.mm_per_unit = 1000;
  table.conventions.second_per_unit = 1;
  table.notes.emplace_back("positions in metres, as HAPI logs them");
}

bool is_binary_device_log(const std::string& path) {
  std::array<char, kLongestWord + 1> head{};
  std::ifstream file(path, std::ios::binary);
  file.read(head.data(), head.size());
  const std::string_view read(head.data(), static_cast<std::size_t>(file.gcount()));
  const std::size_t nul = read.find('\0');
  return nul != std::string_view::npos && !parts_of(read.substr(0, nul)).empty();
}

RecordedTable read_binary_device_log(const std::string& path) {
  const std::string bytes = bytes_of_file(path);
  std::size_t at = 0;
  const std::vector<std::string_view> words = header_words(bytes, path, at);
  const auto names = device_log_names(words);
  if (!names) throw InputError(path, "header", "names no vector", "a log with POSITION is needed");
  std::size_t row_size = 0;
  for (const std::string_view word : words)
    row_size += word == kButtons ? sizeof(std::int32_t) : parts_of(word).size() * sizeof(double);
  const std::size_t rows = (bytes.size() - at) / row_size, rest = (bytes.size() - at) % row_size;
  if (rows < 2) throw InputError(path, "", "holds fewer than two samples", "record a motion");
  if (rows > kMostSamples)
    throw InputError(path, "", fmt::format("more than {} samples", kMostSamples),
                     "cut the recording into pieces");
  require_memory(path, "", static_cast<double>(rows * names->size() * sizeof(double)),
                 "cut the recording into pieces");
  RecordedTable table;
  set_device_log_conventions(table);
  table.kind += ", binary";
  if (rest > 0)
    table.notes.push_back(
        fmt::format("the last row is not whole ({} of {} bytes) and is left out", rest, row_size));
  table.names = *names;
  table.columns.assign(names->size(), std::vector<double>(rows));
  for (std::size_t row = 0; row < rows; ++row) {
    std::size_t column = 0;
    for (const std::string_view word : words) {
      if (word == kButtons) {
        table.columns[column++][row] = number_at<std::int32_t>(bytes.data() + at);
        at += sizeof(std::int32_t);
        continue;
      }
      for (std::size_t n = parts_of(word).size(); n > 0; --n, at += sizeof(double))
        table.columns[column++][row] = number_at<double>(bytes.data() + at);
    }
  }
  check_times(table, path);
  return table;
}

}  // namespace toothprep
