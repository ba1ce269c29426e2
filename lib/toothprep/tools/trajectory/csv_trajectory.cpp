#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <map>
#include <optional>
#include <string_view>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/nearest_name.h"
#include "toothprep/tools/io/input_file.h"
#include "toothprep/tools/io/memory_limit.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {
namespace {

const std::vector<std::string> kColumns = {"time_s", "x_mm", "y_mm",     "z_mm",     "qx",
                                           "qy",     "qz",   "qw",       "buttons",  "fx_N",
                                           "fy_N",   "fz_N", "load_x_N", "load_y_N", "load_z_N"};
constexpr std::size_t kTime = 0, kPosition = 1, kQuaternion = 4, kButtons = 8, kForce = 9,
                      kLoad = 12;

// Lines of a text file, of at most 64 kB each (more is not a table), without their line ends. A
// line is valid until the next one is asked for.
class LineReader {
 public:
  explicit LineReader(const std::string& path) : file_(path) {}

  bool next(std::string_view& line) {
    std::size_t stop = end_of_line();
    if (stop == end_) {
      refill();
      stop = end_of_line();
    }
    if (begin_ == end_) return false;
    line = std::string_view(buffer_.data() + begin_, stop - begin_);
    if (line.size() > kLongestLine)
      throw InputError(file_.path(), "line " + std::to_string(number_ + 1), "is longer than 64 kB",
                       "this is not a CSV table");
    begin_ = std::min(stop + 1, end_);
    ++number_;
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    return true;
  }
  std::size_t number() const { return number_; }

  // How many lines the file has in all.
  std::size_t count() const {
    std::vector<char> bytes(kBlock);
    std::size_t lines = 0;
    char last = '\n';
    for (std::uint64_t at = 0; at < file_.size(); at += kBlock) {
      const std::size_t n = file_.read(at, bytes.size(), bytes.data());
      lines += static_cast<std::size_t>(
          std::count(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n), '\n'));
      if (n > 0) last = bytes[n - 1];
    }
    return lines + (last == '\n' ? 0 : 1);
  }

 private:
  static constexpr std::size_t kLongestLine = 1 << 16, kBlock = 1 << 20;

  std::size_t end_of_line() const {
    const void* at = std::memchr(buffer_.data() + begin_, '\n', end_ - begin_);
    return at ? static_cast<std::size_t>(static_cast<const char*>(at) - buffer_.data()) : end_;
  }
  // Keeps what is left of the buffer, and reads on behind it.
  void refill() {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
    const std::size_t n = file_.read(place_, buffer_.size() - end_, buffer_.data() + end_);
    place_ += n;
    end_ += n;
  }

  InputFile file_;
  std::vector<char> buffer_ = std::vector<char>(kBlock + kLongestLine);
  std::size_t begin_ = 0, end_ = 0, number_ = 0;
  std::uint64_t place_ = 0;  // in the file, of the buffer's end
};

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

void split(std::string_view line, std::vector<std::string_view>& fields) {
  fields.clear();
  for (;;) {
    const std::size_t comma = line.find(',');
    fields.push_back(trimmed(line.substr(0, comma)));
    if (comma == std::string_view::npos) return;
    line.remove_prefix(comma + 1);
  }
}

std::string quoted(std::string_view text) {
  std::string result = "'";
  for (const char c : text.substr(0, 40)) result += c >= ' ' && c <= '~' ? c : '?';
  return result + (text.size() > 40 ? "...'" : "'");
}

// Where each known column stands in the file, if it does: kColumns, then the further ones.
struct Header {
  std::vector<std::string> names;
  std::vector<std::optional<std::size_t>> at;
  std::size_t columns = 0;

  bool has(std::size_t column) const { return at[column].has_value(); }
};

Header read_header(std::string_view line, const std::string& path,
                   const std::vector<std::string>& also) {
  std::string expected =
      "the header is time_s,x_mm,y_mm,z_mm[,qx,qy,qz,qw][,buttons][,fx_N,fy_N,fz_N]"
      "[,load_x_N,load_y_N,load_z_N]";
  for (const std::string& name : also) expected += "[," + name + "]";
  if (line.substr(0, 3) == "\xef\xbb\xbf") line.remove_prefix(3);  // byte order mark
  Header header;
  header.names = kColumns;
  header.names.insert(header.names.end(), also.begin(), also.end());
  header.at.resize(header.names.size());
  std::vector<std::string_view> names;
  split(line, names);
  for (const std::string_view name : names) {
    const std::string place = "line 1, column " + std::to_string(header.columns + 1);
    std::size_t column = 0;
    while (column < header.names.size() && header.names[column] != name) ++column;
    if (column == header.names.size())
      throw InputError(path, place,
                       "unknown column " + quoted(name) + " (did you mean '" +
                           nearest_name(name, header.names) + "'?)",
                       expected);
    if (header.has(column))
      throw InputError(path, place, "column " + quoted(name) + " stands twice", expected);
    header.at[column] = header.columns++;
  }
  const auto require = [&](std::size_t first, std::size_t count) {
    for (std::size_t c = first; c < first + count; ++c)
      if (!header.has(c))
        throw InputError(path, "line 1", "column '" + kColumns[c] + "' is missing", expected);
  };
  const auto any = [&](std::size_t first, std::size_t count) {
    for (std::size_t c = first; c < first + count; ++c)
      if (header.has(c)) return true;
    return false;
  };
  require(kTime, 4);
  if (any(kQuaternion, 4)) require(kQuaternion, 4);
  if (any(kForce, 3)) require(kForce, 3);
  if (any(kLoad, 3)) require(kLoad, 3);
  return header;
}

// Refuses a table that can't be held before its rows are read.
void check_size(const std::string& path, const Header& header, std::size_t rows) {
  if (rows > kMostSamples)
    throw InputError(path, "", "more than " + std::to_string(kMostSamples) + " samples",
                     "cut the recording into pieces");
  const double bytes =
      static_cast<double>(rows) *
      static_cast<double>(sizeof(HandleSample) + (header.has(kForce) ? sizeof(Vec3) : 0) +
                          (header.names.size() - kColumns.size()) * sizeof(double));
  const auto free = static_cast<double>(available_memory());
  if (bytes > free)
    throw InputError(path, "",
                     "holds " + std::to_string(rows) + " samples, which take " + size_text(bytes) +
                         " of memory where " + size_text(free) + " are free",
                     "cut the recording into pieces");
}

// The table's rows, one after another.
class RowReader {
 public:
  RowReader(const std::string& path, const Header& header)
      : path_(path), header_(header), value_(header.names.size()), column_of_(header.columns) {
    for (std::size_t c = 0; c < header.names.size(); ++c)
      if (header.at[c]) column_of_[*header.at[c]] = c;
  }

  // The values of a line, by column.
  const std::vector<double>& values(std::string_view line, std::size_t number) {
    number_ = number;
    split(line, fields_);
    if (fields_.size() != header_.columns)
      refuse("",
             "has " + std::to_string(fields_.size()) + " columns where the header has " +
                 std::to_string(header_.columns),
             "is the file complete?");
    for (std::size_t i = 0; i < fields_.size(); ++i) {
      double& value = value_[column_of_[i]];
      const char* end = fields_[i].data() + fields_[i].size();
      const auto [stop, error] = std::from_chars(fields_[i].data(), end, value);
      if (error != std::errc() || stop != end || !std::isfinite(value))
        refuse(header_.names[column_of_[i]], quoted(fields_[i]) + " is not a finite number");
    }
    return value_;
  }

  // The handle's sample of the last line.
  HandleSample sample() const {
    HandleSample s;
    s.time = value_[kTime];
    s.pose.position = {value_[kPosition], value_[kPosition + 1], value_[kPosition + 2]};
    if (header_.has(kQuaternion)) {
      const Quat q(value_[kQuaternion + 3], value_[kQuaternion], value_[kQuaternion + 1],
                   value_[kQuaternion + 2]);
      if (!accept_quaternion(q, s.pose.orientation))
        refuse("", "qx,qy,qz,qw is not of unit length",
               "write unit quaternions in the order x, y, z, w");
    }
    if (header_.has(kButtons)) {
      const double b = value_[kButtons];
      if (!(b >= 0 && b <= 4294967295.0 && b == std::floor(b)))
        refuse("buttons", "must be a whole number of 0 or more (bit 0: motor on)");
      s.buttons = static_cast<std::uint32_t>(b);
    }
    if (header_.has(kLoad)) s.load = {value_[kLoad], value_[kLoad + 1], value_[kLoad + 2]};
    return s;
  }

  [[noreturn]] void refuse(const std::string& column, const std::string& condition,
                           const std::string& remedy = {}) const {
    throw InputError(
        path_, "line " + std::to_string(number_) + (column.empty() ? "" : ", column " + column),
        condition, remedy);
  }

 private:
  const std::string& path_;
  const Header& header_;
  std::size_t number_ = 0;
  std::vector<double> value_;
  std::vector<std::size_t> column_of_;  // of each field
  std::vector<std::string_view> fields_;
};

}  // namespace

Trajectory read_csv_trajectory(const std::string& path) {
  std::map<std::string, std::vector<double>> none;
  return read_csv_trajectory(path, {}, none);
}

Trajectory read_csv_trajectory(const std::string& path, const std::vector<std::string>& also,
                               std::map<std::string, std::vector<double>>& further) {
  LineReader lines(path);
  std::string_view line;
  if (!lines.next(line)) throw InputError(path, "", "is empty", "a header line is needed");
  const Header header = read_header(line, path, also);

  const std::size_t rows = lines.count() - 1;
  check_size(path, header, rows);
  Trajectory trajectory;
  trajectory.samples.reserve(rows);
  trajectory.loaded = header.has(kLoad);
  if (header.has(kForce)) trajectory.measured_force.reserve(rows);
  for (std::size_t c = kColumns.size(); c < header.names.size(); ++c)
    if (header.has(c)) further[header.names[c]].reserve(rows);

  RowReader reader(path, header);
  bool ended = false;  // by a blank line: only blank ones may follow
  while (lines.next(line)) {
    if (trimmed(line).empty()) {
      ended = true;
      continue;
    }
    if (ended)
      throw InputError(path, "line " + std::to_string(lines.number()), "follows a blank line",
                       "remove the blank line");
    const std::vector<double>& value = reader.values(line, lines.number());
    const HandleSample sample = reader.sample();
    if (!trajectory.samples.empty() && !(sample.time > trajectory.samples.back().time))
      reader.refuse("time_s", "time does not increase");
    trajectory.samples.push_back(sample);
    if (header.has(kForce))
      trajectory.measured_force.emplace_back(value[kForce], value[kForce + 1], value[kForce + 2]);
    for (std::size_t c = kColumns.size(); c < header.names.size(); ++c)
      if (header.has(c)) further[header.names[c]].push_back(value[c]);
  }
  if (trajectory.samples.size() < 2)
    throw InputError(path, "", "holds fewer than two samples", "record a motion");
  return trajectory;
}

}  // namespace toothprep
