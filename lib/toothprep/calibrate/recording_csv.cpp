// The CSV table of a recording: that of a trajectory and what else a rig records.
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <optional>
#include <string_view>

#include "toothprep/calibrate/recording.h"
#include "toothprep/core/errors.h"
#include "toothprep/core/nearest_name.h"

namespace toothprep {
namespace {

const std::vector<std::string> kColumns = {"time_s",
                                           "x_mm",
                                           "y_mm",
                                           "z_mm",
                                           "qx",
                                           "qy",
                                           "qz",
                                           "qw",
                                           "buttons",
                                           "fx_N",
                                           "fy_N",
                                           "fz_N",
                                           "rotation_rate_rev_s",
                                           "torque_mNm",
                                           "stalled"};
constexpr std::size_t kTime = 0, kPosition = 1, kQuaternion = 4, kButtons = 8, kForce = 9,
                      kRate = 12, kTorque = 13, kStalled = 14, kColumnCount = 15;

std::vector<std::string_view> split(std::string_view line) {
  std::vector<std::string_view> fields;
  for (;;) {
    const std::size_t comma = line.find(',');
    std::string_view field = line.substr(0, comma);
    while (!field.empty() && (field.front() == ' ' || field.front() == '\t'))
      field.remove_prefix(1);
    while (!field.empty() && (field.back() == ' ' || field.back() == '\t')) field.remove_suffix(1);
    fields.push_back(field);
    if (comma == std::string_view::npos) return fields;
    line.remove_prefix(comma + 1);
  }
}

bool next_line(std::istream& in, std::string& line) {
  if (!std::getline(in, line)) return false;
  if (!line.empty() && line.back() == '\r') line.pop_back();
  return true;
}

std::string printable(std::string_view text) {
  std::string shown = "'";
  for (const char c : text.substr(0, 40)) shown += c >= ' ' && c <= '~' ? c : '?';
  return shown + "'";
}

}  // namespace

MeasuredRecording read_recording_csv(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::string line;
  if (!in || !next_line(in, line)) {
    if (in.is_open() && in.eof()) throw InputError(path, "", "is empty", "a header line is needed");
    throw InputError(path, "", "cannot be read", "check that the file exists");
  }
  std::string_view head = line;
  if (head.substr(0, 3) == "\xef\xbb\xbf") head.remove_prefix(3);  // byte order mark
  const std::string expected =
      "the header is time_s,x_mm,y_mm,z_mm[,qx,qy,qz,qw][,buttons],fx_N,fy_N,fz_N"
      "[,rotation_rate_rev_s][,torque_mNm][,stalled]";
  std::array<bool, kColumnCount> has{};
  std::vector<std::size_t> column_of;
  for (const std::string_view name : split(head)) {
    const std::string place = "line 1, column " + std::to_string(column_of.size() + 1);
    std::size_t c = 0;
    while (c < kColumnCount && kColumns[c] != name) ++c;
    if (c == kColumnCount)
      throw InputError(path, place,
                       "unknown column " + printable(name) + " (did you mean '" +
                           nearest_name(name, kColumns) + "'?)",
                       expected);
    if (has[c]) throw InputError(path, place, "column " + kColumns[c] + " stands twice", expected);
    has[c] = true;
    column_of.push_back(c);
  }
  const auto require = [&](std::size_t first, std::size_t count) {
    for (std::size_t c = first; c < first + count; ++c)
      if (!has[c])
        throw InputError(path, "line 1", "column '" + kColumns[c] + "' is missing", expected);
  };
  require(kTime, 4);
  if (has[4] || has[5] || has[6] || has[7]) require(kQuaternion, 4);
  if (has[9] || has[10] || has[11]) require(kForce, 3);

  MeasuredRecording r;
  std::array<double, kColumnCount> value{};
  bool ended = false;  // by a blank line: only blank ones may follow
  for (std::size_t row = 2; next_line(in, line); ++row) {
    const std::string place = "line " + std::to_string(row);
    if (line.find_first_not_of(" \t") == std::string::npos) {
      ended = true;
      continue;
    }
    if (ended) throw InputError(path, place, "follows a blank line", "remove the blank line");
    const std::vector<std::string_view> fields = split(line);
    if (fields.size() != column_of.size())
      throw InputError(path, place,
                       "has " + std::to_string(fields.size()) + " columns where the header has " +
                           std::to_string(column_of.size()),
                       "is the file complete?");
    for (std::size_t i = 0; i < fields.size(); ++i) {
      const char* end = fields[i].data() + fields[i].size();
      double& v = value[column_of[i]];
      const auto [stop, error] = std::from_chars(fields[i].data(), end, v);
      if (error != std::errc() || stop != end || !std::isfinite(v))
        throw InputError(path, place + ", column " + kColumns[column_of[i]],
                         printable(fields[i]) + " is not a finite number");
    }
    const auto whole = [&](std::size_t c, double most) {
      if (!(value[c] >= 0 && value[c] <= most && value[c] == std::floor(value[c])))
        throw InputError(path, place + ", column " + kColumns[c],
                         most == 1 ? "must be 0 or 1" : "must be a whole number of 0 or more");
    };
    HandleSample sample;
    sample.time = value[kTime];
    sample.pose.position = {value[kPosition], value[kPosition + 1], value[kPosition + 2]};
    if (!r.motion.samples.empty() && !(sample.time > r.motion.samples.back().time))
      throw InputError(path, place + ", column time_s", "time does not increase");
    if (has[kQuaternion] && !accept_quaternion(Quat(value[kQuaternion + 3], value[kQuaternion],
                                                    value[kQuaternion + 1], value[kQuaternion + 2]),
                                               sample.pose.orientation))
      throw InputError(path, place, "qx,qy,qz,qw is not of unit length",
                       "write unit quaternions in the order x, y, z, w");
    if (has[kButtons]) {
      whole(kButtons, 4294967295.0);
      sample.buttons = static_cast<std::uint32_t>(value[kButtons]);
    }
    if (r.motion.samples.size() == kMostSamples)
      throw InputError(path, place, "more than " + std::to_string(kMostSamples) + " samples",
                       "cut the recording into pieces");
    r.motion.samples.push_back(sample);
    if (has[kForce])
      r.motion.measured_force.emplace_back(value[kForce], value[kForce + 1], value[kForce + 2]);
    if (has[kRate]) r.rotation_rate.push_back(value[kRate]);
    if (has[kTorque]) r.torque.push_back(value[kTorque]);
    if (has[kStalled]) {
      whole(kStalled, 1);
      r.stalled.push_back(value[kStalled] > 0);
    }
  }
  if (r.motion.samples.size() < 2)
    throw InputError(path, "", "holds fewer than two samples", "record a motion");
  return r;
}

}  // namespace toothprep
