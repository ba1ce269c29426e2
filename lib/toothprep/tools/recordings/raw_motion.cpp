#include "toothprep/tools/recordings/raw_motion.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <functional>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr double kOffUnit =
    0.02;  // of a quaternion's length, a matrix's columns: rounded to 2 digits
constexpr double kFullTurn = 6.5;  // above it, angles are degrees
const std::vector<std::string> kX = {"x", "y", "z"};
const std::vector<std::string> kQ = {"qx", "qy", "qz", "qw"};
const std::vector<std::string> kR = {"rx", "ry", "rz"};
const std::vector<std::string> kE = {"e1", "e2", "e3"};
const std::vector<std::string> kM = {"r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33"};
const std::vector<std::string> kA = {"axis_x", "axis_y", "axis_z", "angle"};
const std::vector<std::string> kF = {"fx", "fy", "fz"};

using Columns = std::vector<const std::vector<double>*>;

Columns columns_of(const RecordedTable& table, const ColumnRoles& roles,
                   const std::vector<std::string>& keys) {
  Columns columns;
  for (const std::string& key : keys) columns.push_back(&table.columns[roles.of.at(key).column]);
  return columns;
}

bool complete(const Columns& columns, std::size_t row) {
  return std::none_of(columns.begin(), columns.end(),
                      [row](const auto* c) { return std::isnan((*c)[row]); });
}

void note_columns(const RecordedTable& table, const ColumnRoles& roles,
                  const std::vector<std::string>& keys, ImportedRecording& report) {
  for (const std::string& key : keys) {
    const ColumnRole& role = roles.of.at(key);
    report.columns.push_back({key, table.names[role.column], role.unit});
  }
}

// The quaternion's columns as x, y, z, w.
Columns quaternion_columns(const RecordedTable& table, const ColumnRoles& roles,
                           QuaternionOrder order, ImportedRecording& report) {
  if (order == QuaternionOrder::kAsNamed) {
    if (roles.scalar_first)
      report.warnings.push_back(
          "of q0 to q3, q0 is taken for the scalar; if it is the last: "
          "--quaternion xyzw");
    return columns_of(table, roles, kQ);
  }
  std::vector<std::size_t> place;
  for (const std::string& key : kQ) place.push_back(roles.of.at(key).column);
  std::sort(place.begin(), place.end());
  if (order == QuaternionOrder::kWxyz) std::rotate(place.begin(), place.begin() + 1, place.end());
  Columns columns;
  for (const std::size_t c : place) columns.push_back(&table.columns[c]);
  return columns;
}

// Radians per unit of the angles in these columns.
double angle_unit(const RecordedTable& table, const ColumnRoles& roles,
                  const std::vector<std::string>& keys, const ImportSettings& s,
                  const std::string& path, ImportedRecording& report) {
  if (s.radian_per_unit) return *s.radian_per_unit;
  double largest = 0;
  for (const std::string& key : keys) {
    std::string unit = roles.of.at(key).unit;
    for (char& c : unit) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    if (unit == "deg" || unit == "°") return units::kPi / 180;
    if (unit == "rad") return 1;
    for (const double a : table.columns[roles.of.at(key).column])
      if (!std::isnan(a)) largest = std::max(largest, std::abs(a));
  }
  if (largest > kFullTurn) {
    report.warnings.push_back(
        fmt::format("angles taken for degrees: the largest is {:.4g}", largest));
    return units::kPi / 180;
  }
  throw InputError(path, "angles", "could be degrees or radians",
                   "say the unit with --angle-unit deg or rad");
}

// Turns about the axes of `order` one after another: capitals about the body's own axes.
Quat by_angles(const std::string& order, const std::array<double, 3>& angle) {
  Quat q = Quat::Identity();
  for (std::size_t i = 0; i < 3; ++i) {
    const char axis = order[i];
    const Quat turn(Eigen::AngleAxisd(angle[i], Vec3::Unit(std::tolower(axis) - 'x')));
    q = std::isupper(static_cast<unsigned char>(axis)) ? q * turn : turn * q;
  }
  return q.normalized();
}

// How to make an orientation of a row; empty if the recording has none.
using Orient = std::function<std::optional<Quat>(std::size_t row)>;

Orient by_quaternion(const RecordedTable& table, const ColumnRoles& roles, const ImportSettings& s,
                     const std::string& path, ImportedRecording& report) {
  const Columns c = quaternion_columns(table, roles, s.quaternion, report);
  return [c, &table, path](std::size_t row) -> std::optional<Quat> {
    const Quat q((*c[3])[row], (*c[0])[row], (*c[1])[row], (*c[2])[row]);
    if (!(std::abs(q.norm() - 1) <= kOffUnit))
      throw InputError(path, table.place(row) + ", quaternion",
                       fmt::format("has length {:.4g}, not 1", q.norm()),
                       "are these its columns? name them with --columns");
    return q.normalized();
  };
}

Orient by_euler(const RecordedTable& table, const ColumnRoles& roles, const ImportSettings& s,
                const std::string& path, ImportedRecording& report) {
  const bool by_axis = roles.has_all(kR);
  const std::vector<std::string>& keys = by_axis ? kR : kE;
  std::string order = s.euler;
  if (order.empty() && by_axis && report.columns.back().column.find("aw") != std::string::npos) {
    order = "xyz";
    report.warnings.push_back(
        "roll, pitch, yaw taken for turns about the fixed x, y, z, in this "
        "order; another: --euler");
  }
  if (order.empty())
    throw InputError(path, "angles", "could be turns in any order",
                     "say it with --euler, e.g. xyz (fixed axes) or ZYX (the body's own)");
  const double unit = angle_unit(table, roles, keys, s, path, report);
  const Columns c = columns_of(table, roles, keys);
  return [c, order, unit, by_axis](std::size_t row) -> std::optional<Quat> {
    std::array<double, 3> angle{};
    for (std::size_t i = 0; i < 3; ++i) {
      const auto axis = static_cast<std::size_t>(std::tolower(order[i]) - 'x');
      angle[i] = unit * (*c[by_axis ? axis : i])[row];
    }
    return by_angles(order, angle);
  };
}

Orient by_matrix(const RecordedTable& table, const ColumnRoles& roles, const std::string& path) {
  const Columns c = columns_of(table, roles, kM);
  return [c, &table, path](std::size_t row) -> std::optional<Quat> {
    Mat3 m;
    for (int i = 0; i < 9; ++i) m(i / 3, i % 3) = (*c[static_cast<std::size_t>(i)])[row];
    if ((m.transpose() * m - Mat3::Identity()).cwiseAbs().maxCoeff() > kOffUnit ||
        m.determinant() < 0)
      throw InputError(path, table.place(row) + ", rotation matrix",
                       m.determinant() < 0 ? "mirrors" : "is not a rotation",
                       "name its columns r11 ... r33 with --columns");
    return Quat(m).normalized();
  };
}

Orient by_axis_angle(const RecordedTable& table, const ColumnRoles& roles, const ImportSettings& s,
                     const std::string& path, ImportedRecording& report) {
  const Columns c = columns_of(table, roles, kA);
  const double unit =
      table.conventions.mm_per_unit ? 1 : angle_unit(table, roles, {"angle"}, s, path, report);
  return [c, unit](std::size_t row) -> std::optional<Quat> {
    const Vec3 axis((*c[0])[row], (*c[1])[row], (*c[2])[row]);
    const double angle = unit * (*c[3])[row];
    if (!(axis.norm() > 1e-9))
      return angle == 0 ? std::optional<Quat>(Quat::Identity()) : std::nullopt;
    return Quat(Eigen::AngleAxisd(angle, axis.normalized()));
  };
}

Orient orientation_of(const RecordedTable& table, const ColumnRoles& roles, const ImportSettings& s,
                      const std::string& path, Columns& needed, ImportedRecording& report) {
  const auto take = [&](const std::vector<std::string>& keys) {
    note_columns(table, roles, keys, report);
    for (const auto* c : columns_of(table, roles, keys)) needed.push_back(c);
  };
  if (roles.has_all(kQ)) return take(kQ), by_quaternion(table, roles, s, path, report);
  if (roles.has_all(kM)) return take(kM), by_matrix(table, roles, path);
  if (roles.has_all(kR)) return take(kR), by_euler(table, roles, s, path, report);
  if (roles.has_all(kE)) return take(kE), by_euler(table, roles, s, path, report);
  if (roles.has_all(kA)) return take(kA), by_axis_angle(table, roles, s, path, report);
  report.warnings.push_back("no orientation recorded: the bur stands along +z of the recording");
  return {};
}

// Seconds from the first row. Without a time column, by the rate.
std::vector<double> seconds_of(const RecordedTable& table, const ColumnRoles& roles,
                               const ImportSettings& s, const std::string& path,
                               ImportedRecording& report) {
  std::vector<double> time(table.rows());
  if (s.rate_hz) {
    for (std::size_t i = 0; i < time.size(); ++i) time[i] = static_cast<double>(i) / *s.rate_hz;
    return time;
  }
  if (!roles.has("time"))
    throw InputError(path, "header", "no column is a time",
                     "name it with --columns time=NAME, or give --rate-hz");
  note_columns(table, roles, {"time"}, report);
  const std::vector<double>& column = table.columns[roles.of.at("time").column];
  const double unit = second_per_unit(table, roles, path, report);
  report.first_time_s = column.front() * unit;
  for (std::size_t i = 0; i < time.size(); ++i) {
    if (std::isnan(column[i])) throw InputError(path, table.place(i) + ", time", "is no number");
    time[i] = (column[i] - column.front()) * unit;
    if (i > 0 && time[i] < time[i - 1])
      throw InputError(path, table.place(i) + ", time", "goes back",
                       "cut the file there, or take another column for the time");
  }
  return time;
}

std::vector<double> optional_column(const RecordedTable& table, const ColumnRoles& roles,
                                    const std::string& key, ImportedRecording& report) {
  if (!roles.has(key)) return {};
  note_columns(table, roles, {key}, report);
  return table.columns[roles.of.at(key).column];
}

void set_forces(const RecordedTable& table, const ColumnRoles& roles, const ImportSettings& s,
                const std::string& path, std::vector<Vec3>& force, ImportedRecording& report) {
  if (!roles.has_all(kF)) return;
  note_columns(table, roles, kF, report);
  const double unit = newton_per_unit(table, roles, s, path, report) * (s.force_on_tooth ? -1 : 1);
  const Columns c = columns_of(table, roles, kF);
  for (std::size_t i = 0; i < table.rows(); ++i)
    force.push_back(unit * Vec3((*c[0])[i], (*c[1])[i], (*c[2])[i]));
}

// Rates are kept in rev/s.
void to_rev_per_second(const ColumnRoles& roles, std::vector<double>& rate,
                       ImportedRecording& report) {
  if (rate.empty()) return;
  std::string unit = roles.of.at("rotation_rate").unit;
  double largest = 0;
  for (const double r : rate) largest = std::max(largest, std::abs(r));
  const bool per_second = unit == "rev/s" || unit == "Hz";
  if (!per_second && (!unit.empty() || largest > 10000)) {
    for (double& r : rate) r /= 60;
  } else if (!per_second) {
    const bool rpm = report.columns.back().column.find("pm") != std::string::npos;
    if (rpm)
      for (double& r : rate) r /= 60;
    report.notes.push_back(rpm ? "rotation rate in rpm" : "rotation rate taken for rev/s");
  }
}

template <class Value>
void keep_rows(std::vector<Value>& values, const std::vector<char>& keep) {
  if (values.empty()) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < values.size(); ++i)
    if (keep[i]) values[kept++] = values[i];
  values.resize(kept);
}

}  // namespace

void RawMotion::select(const std::vector<char>& keep) {
  keep_rows(time, keep);
  keep_rows(position, keep);
  keep_rows(orientation, keep);
  keep_rows(force, keep);
  for (auto* values : {&buttons, &rotation_rate, &torque, &stalled}) keep_rows(*values, keep);
}

RawMotion raw_motion(const RecordedTable& table, const ColumnRoles& roles, const ImportSettings& s,
                     const std::string& path, ImportedRecording& report) {
  if (!roles.has_all(kX))
    throw InputError(path, "header", "no columns are a position",
                     "name them: --columns x=NAME,y=NAME,z=NAME (or numbers from 1)");
  report.figures.rows = table.rows();
  RawMotion motion;
  motion.time = seconds_of(table, roles, s, path, report);
  note_columns(table, roles, kX, report);
  const double scale = mm_per_unit(table, roles, s, path, report);
  Columns needed = columns_of(table, roles, kX);
  const Columns x = needed;
  const Orient orient = orientation_of(table, roles, s, path, needed, report);
  set_forces(table, roles, s, path, motion.force, report);
  motion.buttons = optional_column(table, roles, "buttons", report);
  motion.rotation_rate = optional_column(table, roles, "rotation_rate", report);
  to_rev_per_second(roles, motion.rotation_rate, report);
  motion.torque = optional_column(table, roles, "torque", report);
  if (roles.has("torque") && roles.of.at("torque").unit == "Nm")
    for (double& torque : motion.torque) torque *= 1000;  // kept in N·mm
  motion.stalled = optional_column(table, roles, "stalled", report);

  std::vector<char> keep(table.rows(), 0);
  motion.position.resize(table.rows());
  if (orient) motion.orientation.resize(table.rows(), Quat::Identity());
  std::size_t last = table.rows();
  for (std::size_t i = 0; i < table.rows(); ++i) {
    if (!complete(needed, i)) {
      ++report.figures.missing;
      continue;
    }
    if (last < i && motion.time[i] == motion.time[last]) {
      ++report.figures.repeated_times;
      continue;
    }
    motion.position[i] = scale * Vec3((*x[0])[i], (*x[1])[i], (*x[2])[i]);
    if (orient) {
      const auto q = orient(i);
      if (!q) {
        ++report.figures.missing;
        continue;
      }
      motion.orientation[i] = *q;
    }
    keep[i] = 1;
    last = i;
  }
  motion.select(keep);
  if (motion.size() < 2)
    throw InputError(path, "", "holds fewer than two samples with a pose", "record a motion");
  return motion;
}

RawForce raw_force(const RecordedTable& table, const ColumnRoles& roles, const ImportSettings& s,
                   const std::string& path, ImportedRecording& report) {
  if (!roles.has_all(kF))
    throw InputError(path, "header", "no columns are a force",
                     "they are called fx, fy, fz or alike");
  RawForce force;
  const double first_motion = report.first_time_s;
  force.time = seconds_of(table, roles, s, path, report);
  const double first = report.first_time_s;
  report.first_time_s = first_motion;
  set_forces(table, roles, s, path, force.force, report);
  std::vector<char> keep(force.time.size());
  for (std::size_t i = 0; i < keep.size(); ++i)
    keep[i] = force.force[i].allFinite() && (i == 0 || force.time[i] > force.time[i - 1]);
  for (double& time : force.time) time += first;  // on its own clock
  keep_rows(force.time, keep);
  keep_rows(force.force, keep);
  if (force.time.size() < 2) throw InputError(path, "force", "holds fewer than two samples");
  return force;
}

}  // namespace toothprep
