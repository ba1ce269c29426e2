// Units of a recording: by option, by the columns' names, by the format, or by what only one unit
// makes plausible.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/statistics.h"
#include "toothprep/tools/recordings/raw_motion.h"

namespace toothprep {
namespace {

struct Unit {
  const char* name;
  double size;
};

// Of a hand at a tooth: what a path spans, and the rates of trackers and of force sensors.
constexpr double kLeastSpan = 1, kMostSpan = 400;                // mm
constexpr double kLeastStep = 1.0 / 20000, kMostStep = 1.0 / 9;  // s
constexpr double kNoPath = 2000;                                 // mm
constexpr double kMostNewtons = 25, kMostShare = 0.05;           // as check_recording() has it

constexpr std::array<Unit, 6> kLengths = {
    {{"mm", 1}, {"m", 1000}, {"um", 1e-3}, {"µm", 1e-3}, {"cm", 10}, {"in", 25.4}}};
constexpr std::array<Unit, 7> kTimes = {
    {{"s", 1}, {"sec", 1}, {"ms", 1e-3}, {"us", 1e-6}, {"µs", 1e-6}, {"ns", 1e-9}, {"min", 60}}};
constexpr std::array<Unit, 6> kForces = {{{"n", 1},
                                          {"mn", 1e-3},
                                          {"gf", 0.00980665},
                                          {"g", 0.00980665},
                                          {"kgf", 9.80665},
                                          {"kg", 9.80665}}};

template <std::size_t N>
std::optional<double> size_of(const std::array<Unit, N>& units, const std::string& name) {
  for (const Unit& unit : units)
    if (lower(name) == unit.name) return unit.size;
  return {};
}

// The unit that the names of these columns say; none if none says one.
template <std::size_t N>
std::optional<double> stated(const std::array<Unit, N>& units, const ColumnRoles& roles,
                             const std::vector<std::string>& keys, const RecordedTable& table,
                             const std::string& path) {
  std::optional<double> size;
  for (const std::string& key : keys) {
    const ColumnRole& role = roles.of.at(key);
    if (role.unit.empty()) continue;
    const auto own = size_of(units, role.unit);
    if (!own)
      throw InputError(path, "column '" + table.names[role.column] + "'",
                       "is in '" + role.unit + "', which is no unit of " + key,
                       "name another column with --columns");
    if (size && *size != *own)
      throw InputError(path, "column '" + table.names[role.column] + "'",
                       "is in another unit than the columns beside it");
    size = own;
  }
  return size;
}

// Low and high of the numbers of a column.
std::pair<double, double> range_of(const std::vector<double>& column) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const double x : column)
    if (!std::isnan(x)) low = std::min(low, x), high = std::max(high, x);
  return {low, high};
}

double span(const RecordedTable& table, const ColumnRoles& roles) {
  double widest = 0;
  for (const char* key : {"x", "y", "z"}) {
    const auto [low, high] = range_of(table.columns[roles.of.at(key).column]);
    if (high >= low) widest = std::max(widest, high - low);
  }
  return widest;
}

}  // namespace

double second_per_unit(const RecordedTable& table, const ColumnRoles& roles,
                       const std::string& path, ImportedRecording& report) {
  if (const auto size = stated(kTimes, roles, {"time"}, table, path)) return *size;
  if (table.conventions.second_per_unit) return *table.conventions.second_per_unit;
  const std::vector<double>& time = table.columns[roles.of.at("time").column];
  std::vector<double> steps;
  for (std::size_t i = 1; i < time.size(); ++i)
    if (time[i] > time[i - 1]) steps.push_back(time[i] - time[i - 1]);
  if (steps.empty()) throw InputError(path, "time", "never increases");
  const double step = median(std::move(steps));
  for (const Unit& unit : {Unit{"s", 1}, Unit{"ms", 1e-3}, Unit{"us", 1e-6}, Unit{"ns", 1e-9}}) {
    if (step * unit.size < kLeastStep || step * unit.size > kMostStep) continue;
    if (unit.size != 1)
      report.warnings.push_back(
          fmt::format("times taken for {}: their steps of {:g} are {:.4g} Hz so", unit.name, step,
                      1 / (step * unit.size)));
    return unit.size;
  }
  throw InputError(
      path, "time",
      fmt::format("steps by {:g}, which is no rate of a recording in s, ms, us or ns", step),
      "is it the number of a sample? then name no time, and give --rate-hz");
}

double mm_per_unit(const RecordedTable& table, const ColumnRoles& roles, const ImportSettings& s,
                   const std::string& path, ImportedRecording& report) {
  const double wide = span(table, roles);
  std::optional<double> size = s.mm_per_unit;
  if (!size) size = stated(kLengths, roles, {"x", "y", "z"}, table, path);
  if (!size) size = table.conventions.mm_per_unit;
  if (!size) {
    for (const Unit& unit : {Unit{"mm", 1}, Unit{"m", 1000}, Unit{"um", 1e-3}}) {
      if (wide * unit.size < kLeastSpan || wide * unit.size > kMostSpan) continue;
      size = unit.size;
      report.warnings.push_back(
          fmt::format("positions taken for {}: the path spans {:.4g} mm so; --length-unit says it",
                      unit.name, wide * unit.size));
    }
    if (!size)
      throw InputError(path, "position",
                       fmt::format("spans {:g}, which is no path at a tooth in mm, m or um", wide),
                       "say the unit with --length-unit");
  }
  if (wide * *size > kNoPath) {
    const char* likely = wide <= kMostSpan ? "mm" : wide * 1e-3 <= kMostSpan ? "um" : nullptr;
    throw InputError(
        path, "position",
        fmt::format("spans {:.4g} m in this unit, no path at a tooth", wide * *size / 1000),
        likely ? fmt::format("in {} it would be {:.4g} mm: --length-unit {}", likely,
                             wide * (likely[0] == 'm' ? 1 : 1e-3), likely)
               : std::string("look for damaged samples (--despike)"));
  }
  return *size;
}

double newton_per_unit(const RecordedTable& table, const ColumnRoles& roles,
                       const ImportSettings& s, const std::string& path,
                       ImportedRecording& report) {
  if (s.newton_per_unit) return *s.newton_per_unit;
  std::optional<double> size = stated(kForces, roles, {"fx", "fy", "fz"}, table, path);
  if (!size) size = table.conventions.newton_per_unit;
  if (size) return *size;
  std::vector<double> force;
  for (const char* key : {"fx", "fy", "fz"})
    for (const double f : table.columns[roles.of.at(key).column])
      if (!std::isnan(f)) force.push_back(std::abs(f));
  if (force.empty()) throw InputError(path, "force", "holds no number");
  const double large = quantile(std::move(force), 1 - kMostShare);
  if (large > kMostNewtons)
    throw InputError(path, "force",
                     fmt::format("exceeds {:.4g} in 5 % of the samples, more newtons than a bur is "
                                 "pressed with",
                                 large),
                     "say the unit with --force-unit gf, mN or N");
  report.warnings.push_back(
      fmt::format("forces taken for newtons: 95 % of the components are below {:.3g}", large));
  return 1;
}

}  // namespace toothprep
