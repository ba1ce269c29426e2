#include "toothprep/tools/files/trace_columns.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

template <auto Member>
void get_vector(const StepRecord& row, double* v) {
  Eigen::Map<Vec3>(v, 3) = row.*Member;
}
template <auto Member>
void set_vector(StepRecord& row, const double* v) {
  row.*Member = Vec3(v[0], v[1], v[2]);
}
template <auto Member>
void get_number(const StepRecord& row, double* v) {
  *v = row.*Member;
}
template <auto Member>
void set_number(StepRecord& row, const double* v) {
  row.*Member = *v;
}
template <auto Member>
void get_tissues(const StepRecord& row, double* v) {
  std::copy((row.*Member).begin(), (row.*Member).end(), v);
}
template <auto Member>
void set_tissues(StepRecord& row, const double* v) {
  std::copy(v, v + kTissueCount, (row.*Member).begin());
}
void get_quaternion(const Quat& q, double* v) {
  for (int i = 0; i < 4; ++i) v[i] = q.coeffs()[i];  // x, y, z, w
}

// The power whose value in W is `watt`, so that a file read and written again keeps its bytes.
double from_watt(double watt) {
  const double guess = watt * 1e3;
  for (const double limit :
       {-std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()}) {
    double power = guess;
    for (int i = 0; i < 3; ++i, power = std::nextafter(power, limit))
      if (units::to_watt(power) == watt) return power;
  }
  return guess;
}

std::vector<std::string> xyz(const std::string& name, const std::string& unit) {
  return {name + "_x_" + unit, name + "_y_" + unit, name + "_z_" + unit};
}
std::vector<std::string> quaternion(const std::string& name) {
  return {name + "_qx", name + "_qy", name + "_qz", name + "_qw"};
}
std::vector<std::string> tissues(const std::string& name, const std::string& unit) {
  std::vector<std::string> names;
  for (const auto tissue : kTissueNames) names.push_back(name + "_" + std::string(tissue) + unit);
  return names;
}

using S = StepRecord;
constexpr Storage kReal = Storage::kDouble;

std::vector<TraceColumn> motion_columns() {
  return {{"/time",
           "s",
           1,
           kReal,
           true,
           false,
           {"time_s"},
           [](const S& r, double* v) { *v = r.handle.time; },
           [](S& r, const double* v) { r.handle.time = *v; }},
          {"/handle/position", "mm", 3, kReal, true, false, xyz("handle", "mm"),
           [](const S& r, double* v) { Eigen::Map<Vec3>(v, 3) = r.handle.pose.position; },
           [](S& r, const double* v) { r.handle.pose.position = Vec3(v[0], v[1], v[2]); }},
          {"/handle/orientation", "1", 4, kReal, true, false, quaternion("handle"),
           [](const S& r, double* v) { get_quaternion(r.handle.pose.orientation, v); },
           [](S& r, const double* v) { r.handle.pose.orientation = Quat(v[3], v[0], v[1], v[2]); }},
          {"/handle/buttons",
           "1",
           1,
           Storage::kUint32,
           false,
           false,
           {"handle_buttons"},
           [](const S& r, double* v) { *v = r.handle.buttons; },
           [](S& r, const double* v) { r.handle.buttons = static_cast<std::uint32_t>(*v); }},
          {"/reading_rejected",
           "1",
           1,
           Storage::kUint8,
           false,  // absent in traces of version 0.1
           false,
           {"reading_rejected"},
           [](const S& r, double* v) { *v = r.handle.rejected ? 1 : 0; },
           [](S& r, const double* v) { r.handle.rejected = *v != 0; }},
          {"/bur/position", "mm", 3, kReal, true, false, xyz("bur", "mm"),
           [](const S& r, double* v) { Eigen::Map<Vec3>(v, 3) = r.bur.position; },
           [](S& r, const double* v) { r.bur.position = Vec3(v[0], v[1], v[2]); }},
          {"/bur/orientation", "1", 4, kReal, true, false, quaternion("bur"),
           [](const S& r, double* v) { get_quaternion(r.bur.orientation, v); },
           [](S& r, const double* v) { r.bur.orientation = Quat(v[3], v[0], v[1], v[2]); }},
          {"/bur/velocity", "mm/s", 3, kReal, true, false, xyz("bur_velocity", "mm_s"),
           get_vector<&S::bur_velocity>, set_vector<&S::bur_velocity>}};
}

std::vector<TraceColumn> force_columns() {
  return {{"/force/grinding", "N", 3, kReal, true, false, xyz("force_grinding", "N"),
           get_vector<&S::grinding_force>, set_vector<&S::grinding_force>},
          {"/force/device", "N", 3, kReal, true, false, xyz("force_device", "N"),
           get_vector<&S::device_force>, set_vector<&S::device_force>},
          {"/torque",
           "mN*m",
           1,
           kReal,
           true,
           false,
           {"torque_mNm"},
           get_number<&S::torque>,
           set_number<&S::torque>},
          {"/torque_trial",
           "mN*m",
           1,
           kReal,
           true,
           false,
           {"torque_trial_mNm"},
           get_number<&S::torque_trial>,
           set_number<&S::torque_trial>},
          {"/power",
           "W",
           1,
           kReal,
           true,
           false,
           {"power_W"},
           [](const S& r, double* v) { *v = units::to_watt(r.power); },
           [](S& r, const double* v) { r.power = from_watt(*v); }},
          {"/rotation_rate",
           "rev/s",
           1,
           kReal,
           true,
           false,
           {"rotation_rate_rev_s"},
           get_number<&S::rotation_rate>,
           set_number<&S::rotation_rate>},
          {"/stalled",
           "1",
           1,
           Storage::kUint8,
           true,
           false,
           {"stalled"},
           [](const S& r, double* v) { *v = r.stalled ? 1 : 0; },
           [](S& r, const double* v) { r.stalled_fraction = r.stalled = *v != 0; }},
          {"/stalled_fraction",
           "1",
           1,
           kReal,
           false,  // absent in traces of version 0.1, where a step was stalled as a whole
           false,
           {"stalled_fraction"},
           get_number<&S::stalled_fraction>,
           set_number<&S::stalled_fraction>}};
}

std::vector<TraceColumn> columns_per_tissue() {
  return {{"/contact/area", "mm^2", kTissueCount, kReal, true, true, tissues("contact", "_mm2"),
           get_tissues<&S::contact_area>, set_tissues<&S::contact_area>},
          {"/contact/shank_area",
           "mm^2",
           1,
           kReal,
           false,
           false,
           {"contact_shank_mm2"},
           get_number<&S::shank_contact_area>,
           set_number<&S::shank_contact_area>},
          {"/removed/volume", "mm^3", kTissueCount, kReal, true, true, tissues("removed", "_mm3"),
           get_tissues<&S::removed_volume>, set_tissues<&S::removed_volume>}};
}

std::vector<TraceColumn> make_columns() {
  std::vector<TraceColumn> all;
  for (const auto& columns : {motion_columns(), force_columns(), columns_per_tissue()})
    all.insert(all.end(), columns.begin(), columns.end());
  return all;
}

}  // namespace

const std::vector<TraceColumn>& trace_columns() {
  static const std::vector<TraceColumn> columns = make_columns();
  return columns;
}

}  // namespace toothprep
