#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string_view>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/nearest_name.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {
namespace {

const std::vector<std::string> kColumns = {"time_s", "x_mm", "y_mm",    "z_mm", "qx",   "qy",
                                           "qz",     "qw",   "buttons", "fx_N", "fy_N", "fz_N"};
constexpr std::size_t kTime = 0, kPosition = 1, kQuaternion = 4, kButtons = 8, kForce = 9;

// Lines of a text file, of at most 64 kB each (more is not a table), without their line ends.
class LineReader {
 public:
  explicit LineReader(const std::string& path) : path_(path) {
    std::error_code error;
    if (std::filesystem::is_directory(path, error))
      throw InputError(path, "", "is a folder", "give a CSV file");
    file_.reset(std::fopen(path.c_str(), "rb"));
    if (!file_) throw InputError(path, "", "cannot be read", "check that the file exists");
  }
  bool next(std::string_view& line) {
    line_.clear();
    bool any = false;
    for (;;) {
      if (begin_ == end_) {
        begin_ = 0;
        end_ = std::fread(buffer_.data(), 1, buffer_.size(), file_.get());
        if (end_ == 0) {
          if (std::ferror(file_.get())) throw InputError(path_, "", "cannot be read to its end");
          if (!any) return false;
          break;
        }
      }
      any = true;
      std::size_t stop = begin_;
      while (stop < end_ && buffer_[stop] != '\n') ++stop;
      line_.append(buffer_.data() + begin_, stop - begin_);
      const bool complete = stop < end_;
      begin_ = complete ? stop + 1 : stop;
      if (line_.size() > (1u << 16))
        throw InputError(path_, "line " + std::to_string(number_ + 1), "is longer than 64 kB",
                         "this is not a CSV table");
      if (complete) break;
    }
    ++number_;
    if (!line_.empty() && line_.back() == '\r') line_.pop_back();
    line = line_;
    return true;
  }
  std::size_t number() const { return number_; }

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  std::string path_, line_;
  std::unique_ptr<std::FILE, Close> file_;
  std::vector<char> buffer_ = std::vector<char>(1 << 16);
  std::size_t begin_ = 0, end_ = 0, number_ = 0;
};

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

std::vector<std::string_view> split(std::string_view line) {
  std::vector<std::string_view> fields;
  for (;;) {
    const std::size_t comma = line.find(',');
    fields.push_back(trimmed(line.substr(0, comma)));
    if (comma == std::string_view::npos) return fields;
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
      "the header is time_s,x_mm,y_mm,z_mm[,qx,qy,qz,qw][,buttons][,fx_N,fy_N,fz_N]";
  for (const std::string& name : also) expected += "[," + name + "]";
  if (line.substr(0, 3) == "\xef\xbb\xbf") line.remove_prefix(3);  // byte order mark
  Header header;
  header.names = kColumns;
  header.names.insert(header.names.end(), also.begin(), also.end());
  header.at.resize(header.names.size());
  for (const std::string_view name : split(line)) {
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
  return header;
}

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

  Trajectory trajectory;
  std::vector<double> value(header.names.size());
  std::vector<std::size_t> column_of(header.columns);
  for (std::size_t c = 0; c < header.names.size(); ++c)
    if (header.at[c]) column_of[*header.at[c]] = c;
  bool ended = false;  // by a blank line: only blank ones may follow
  while (lines.next(line)) {
    const std::string row = "line " + std::to_string(lines.number());
    if (trimmed(line).empty()) {
      ended = true;
      continue;
    }
    if (ended) throw InputError(path, row, "follows a blank line", "remove the blank line");
    const std::vector<std::string_view> fields = split(line);
    if (fields.size() != header.columns)
      throw InputError(path, row,
                       "has " + std::to_string(fields.size()) + " columns where the header has " +
                           std::to_string(header.columns),
                       "is the file complete?");
    for (std::size_t i = 0; i < fields.size(); ++i) {
      const std::size_t c = column_of[i];
      const char* end = fields[i].data() + fields[i].size();
      const auto [stop, error] = std::from_chars(fields[i].data(), end, value[c]);
      if (error != std::errc() || stop != end || !std::isfinite(value[c]))
        throw InputError(path, row + ", column " + header.names[c],
                         quoted(fields[i]) + " is not a finite number");
    }
    HandleSample sample;
    sample.time = value[kTime];
    sample.pose.position = {value[kPosition], value[kPosition + 1], value[kPosition + 2]};
    if (!trajectory.samples.empty() && !(sample.time > trajectory.samples.back().time))
      throw InputError(path, row + ", column time_s", "time does not increase");
    if (header.has(kQuaternion)) {
      const Quat q(value[kQuaternion + 3], value[kQuaternion], value[kQuaternion + 1],
                   value[kQuaternion + 2]);
      if (!accept_quaternion(q, sample.pose.orientation))
        throw InputError(path, row, "qx,qy,qz,qw is not of unit length",
                         "write unit quaternions in the order x, y, z, w");
    }
    if (header.has(kButtons)) {
      const double b = value[kButtons];
      if (!(b >= 0 && b <= 4294967295.0 && b == std::floor(b)))
        throw InputError(path, row + ", column buttons",
                         "must be a whole number of 0 or more (bit 0: motor on)");
      sample.buttons = static_cast<std::uint32_t>(b);
    }
    if (trajectory.samples.size() == kMostSamples)
      throw InputError(path, row, "more than " + std::to_string(kMostSamples) + " samples",
                       "cut the recording into pieces");
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
