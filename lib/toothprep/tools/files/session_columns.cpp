#include "toothprep/tools/files/session_columns.h"

namespace toothprep {
namespace {

using Recording = SessionRecording;

template <auto Field, auto Column>
SessionColumn number(const char* dataset, const char* unit, Storage storage, bool mirror = false) {
  return {dataset,
          unit,
          1,
          storage,
          mirror,
          [](const LiveTick& t, double* v) { *v = static_cast<double>(t.*Field); },
          [](Recording& r, const double* v) {
            auto& column = r.*Column;
            column.push_back(static_cast<typename std::decay_t<decltype(column)>::value_type>(*v));
          }};
}

template <auto Field, auto Column>
SessionColumn vector(const char* dataset, const char* unit, bool mirror = false) {
  return {dataset,
          unit,
          3,
          Storage::kDouble,
          mirror,
          [](const LiveTick& t, double* v) { Eigen::Map<Vec3>(v, 3) = t.*Field; },
          [](Recording& r, const double* v) { (r.*Column).emplace_back(v[0], v[1], v[2]); }};
}

template <auto Field, auto Column>
SessionColumn quaternion(const char* dataset, bool mirror = false) {
  return {dataset,
          "1",
          4,
          Storage::kDouble,
          mirror,
          [](const LiveTick& t, double* v) {
            for (int i = 0; i < 4; ++i) v[i] = (t.*Field).coeffs()[i];  // x, y, z, w
          },
          [](Recording& r, const double* v) { (r.*Column).emplace_back(v[3], v[0], v[1], v[2]); }};
}

std::vector<SessionColumn> make_session_columns() {
  using T = LiveTick;
  using R = Recording;
  return {
      number<&T::servo_time, &R::servo_time>("/servo/time", "s", Storage::kDouble),
      number<&T::tick, &R::tick>("/servo/tick", "1", Storage::kInt64),
      number<&T::missed, &R::missed>("/servo/missed", "1", Storage::kInt32),
      number<&T::step_seconds, &R::step_seconds>("/servo/step_time", "s", Storage::kDouble),
      number<&T::flags, &R::flags>("/servo/flags", "1", Storage::kUint32),
      number<&T::fault, &R::fault>("/servo/fault", "1", Storage::kUint32),
      vector<&T::commanded_force, &R::force_commanded>("/servo/force_commanded", "N"),
      vector<&T::sent_force, &R::force_sent>("/servo/force_sent", "N"),
      number<&T::force_scale, &R::force_scale>("/servo/force_scale", "1", Storage::kDouble),
      vector<&T::device_position, &R::device_position>("/device/position", "mm"),
      quaternion<&T::device_orientation, &R::device_orientation>("/device/orientation"),
      number<&T::device_buttons, &R::device_buttons>("/device/buttons", "1", Storage::kUint32),
      vector<&T::mirror_position, &R::mirror_position>("/mirror/position", "mm", true),
      quaternion<&T::mirror_orientation, &R::mirror_orientation>("/mirror/orientation", true),
      number<&T::mirror_buttons, &R::mirror_buttons>("/mirror/buttons", "1", Storage::kUint32,
                                                     true),
  };
}

}  // namespace

const std::vector<SessionColumn>& session_columns() {
  static const std::vector<SessionColumn> columns = make_session_columns();
  return columns;
}

}  // namespace toothprep
