#include "toothprep/tools/files/session_file.h"

#include <limits>

#include "toothprep/tools/files/session_columns.h"
#include "toothprep/tools/files/trace_parts.h"

namespace toothprep {
namespace {

bool says_live(const h5::Reader& in) { return in.number("live").value_or(0) == 1; }

std::string text(const h5::Reader& in, const char* name) { return in.text(name).value_or(""); }
double number(const h5::Reader& in, const char* name) { return in.number(name).value_or(0); }

Vec3 point(const h5::Reader& in, const char* name) {
  const auto v = in.numbers(name, 3);
  return v ? Vec3((*v)[0], (*v)[1], (*v)[2]) : Vec3::Zero();
}

void read_header(const h5::Reader& in, SessionHeader& header) {
  header.device_kind = text(in, "device_kind");
  header.device_name = text(in, "device_name");
  header.device_model = text(in, "device_model");
  header.device_vendor = text(in, "device_vendor");
  header.device_driver = text(in, "device_driver");
  header.device_serial = text(in, "device_serial");
  header.device_firmware = text(in, "device_firmware");
  header.mirror_model = text(in, "mirror_model");
  header.rate_hz = number(in, "device_rate_hz");
  header.max_force_n = number(in, "device_max_force_n");
  header.max_continuous_force_n = number(in, "device_max_continuous_force_n");
  header.max_stiffness_n_per_mm = number(in, "device_max_stiffness_n_per_mm");
  header.max_damping_n_s_per_mm = number(in, "device_max_damping_n_s_per_mm");
  header.workspace_min = point(in, "device_workspace_min_mm");
  header.workspace_max = point(in, "device_workspace_max_mm");
  std::string notes = text(in, "device_limit_notes");
  while (!notes.empty()) {
    const std::size_t end = notes.find('\n');
    header.limit_notes.push_back(notes.substr(0, end));
    notes.erase(0, end == std::string::npos ? end : end + 1);
  }
  header.force_limit_n = number(in, "force_limit_n");
  header.force_rate_limit_n_per_s = number(in, "force_rate_limit_n_per_s");
  if (in.number(kSafetyAttributes[0].name)) {
    SafetyLimits& limits = header.safety.emplace();
    for (const SafetyAttribute& a : kSafetyAttributes) limits.*a.value = number(in, a.name);
  }
  header.safety_switch = text(in, "safety_switch");
  header.registration.position = point(in, "registration_position_mm");
  header.laid_at_start = !header.registration.position.allFinite();
  if (header.laid_at_start) header.registration.position.setZero();
  if (const auto q = in.numbers("registration_orientation", 4))
    header.registration.orientation =
        in.quaternion("attribute registration_orientation", 0, q->data());
  const auto hand = in.numbers("registration_hand_orientation", 4);
  const Vec3 at = point(in, "registration_hand_position_mm");
  if (hand && at.allFinite())
    header.registration_hand = {
        at, in.quaternion("attribute registration_hand_orientation", 0, hand->data())};
  header.protocol = text(in, "protocol");
  header.pedal = text(in, "pedal");
  header.host = text(in, "host");
}

// Least and most of the whole numbers that a dataset holds.
std::pair<double, double> range(Storage storage) {
  constexpr double exact = 9007199254740992.0;  // 2^53: what a double counts exactly
  switch (storage) {
    case Storage::kUint8:
      return {0, 255};
    case Storage::kUint32:
      return {0, std::numeric_limits<std::uint32_t>::max()};
    case Storage::kInt32:
      return {std::numeric_limits<std::int32_t>::min(), std::numeric_limits<std::int32_t>::max()};
    default:
      return {-exact, exact};
  }
}

SessionRecording parse_session(h5::Reader& in) {
  if (!says_live(in))
    in.refuse("attribute live", "is missing: this is not the recording of a live session",
              "record one with toothprep live");
  std::vector<std::string> names;
  for (const SessionColumn& column : session_columns()) names.emplace_back(column.dataset);
  in.cut_to_shortest(names);
  SessionRecording recording;
  recording.header.trace = parse_trace(in);
  read_header(in, recording.header);
  recording.complete = in.complete();
  recording.recovered = number(in, "recovered") == 1;
  if (recording.complete) {  // else they may be half written
    recording.dropped_ticks = static_cast<std::int64_t>(number(in, "dropped_ticks"));
    recording.end_reason = text(in, "end_reason");
  }
  const std::size_t rows = recording.header.trace.rows.size();
  for (const SessionColumn& column : session_columns()) {
    if (!in.has(column.dataset)) {
      if (column.mirror) continue;
      in.refuse(column.dataset, "is missing");
    }
    const std::vector<double> values =
        in.read(in.open(column.dataset, column.unit, column.width, true));
    for (std::size_t i = 0; i < rows; ++i) {
      const double* v = values.data() + i * static_cast<std::size_t>(column.width);
      if (column.storage != Storage::kDouble) {
        const auto [least, most] = range(column.storage);
        in.whole_number(column.dataset, i, *v, least, most);
      }
      if (column.width == 4) in.quaternion(column.dataset, i, v);
      column.add(recording, v);
    }
  }
  return recording;
}

}  // namespace

bool is_session_file(const std::string& path, ReadPolicy policy) {
  return h5::read_with_care(path, policy, says_live, h5::Extent::kGlance);
}

SessionRecording read_session(const std::string& path, ReadPolicy policy) {
  return h5::read_with_care(path, policy, parse_session);
}

}  // namespace toothprep
