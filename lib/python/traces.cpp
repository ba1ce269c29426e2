// Traces as arrays under their datasets' names.
#include <cmath>

#include "bindings.h"
#include "long_work.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/tools/files/body_columns.h"
#include "toothprep/tools/files/trace.h"
#include "toothprep/tools/files/trace_columns.h"
#include "toothprep/tools/files/trajectory_file.h"
#include "toothprep/tools/io/outputs.h"

namespace toothprep::python {
namespace {

constexpr const char* kMeasured = "force/measured";
constexpr const char* kApplied = "force/applied";
constexpr const char* kBodyArea = "contact/body_area";

std::string key_of(const TraceColumn& column) { return std::string(column.dataset).substr(1); }

std::vector<py::ssize_t> shape_of(std::size_t rows, int width) {
  if (width == 1) return {static_cast<py::ssize_t>(rows)};
  return {static_cast<py::ssize_t>(rows), width};
}

template <class T>
py::array column_array(const TraceColumn& column, const std::vector<StepRecord>& rows) {
  py::array_t<T> out(shape_of(rows.size(), column.width));
  T* at = out.mutable_data();
  double values[4] = {};
  for (const StepRecord& row : rows) {
    column.get(row, values);
    for (int c = 0; c < column.width; ++c) *at++ = static_cast<T>(values[c]);
  }
  return out;
}

py::array column_array(const TraceColumn& column, const std::vector<StepRecord>& rows) {
  if (column.storage == Storage::kUint32) return column_array<std::uint32_t>(column, rows);
  if (column.storage == Storage::kUint8) return column_array<std::uint8_t>(column, rows);
  return column_array<double>(column, rows);
}

py::dict attributes_of(const Trace& trace) {
  py::dict a;
  a["toothprep_version"] = trace.toothprep_version;
  a["parameters"] = trace.parameters_toml;
  a["tooth_sha256"] = trace.tooth_sha256;
  a["bur"] = trace.bur;
  a["drive"] = trace.drive;
  a["engine"] = trace.engine;
  a["initial_overlap_mm3"] = trace.initial_overlap_mm3;
  a["torque_work_mJ"] = trace.audit.torque_work_mj;
  a["removed_energy_mJ"] = trace.audit.removed_energy_mj;
  a["energy_ratio"] = trace.audit.energy_ratio;
  if (trace.rows_every > 1) a["rows_every"] = trace.rows_every;
  if (!trace.bodies.empty()) a["bodies"] = bodies_text(trace.bodies);
  if (trace.events.events.empty()) return a;
  py::list events;
  for (const SessionEvent& e : trace.events.events)
    events.append(py::make_tuple(e.time, std::string(name_of(e.kind)), e.arguments));
  a["events"] = events;
  a["event_burs"] = trace.events.burs;
  return a;
}

SessionEvents events_of(const py::dict& attributes) {
  SessionEvents all;
  if (!attributes.contains("events")) return all;
  for (const py::handle& item : attributes["events"]) {
    const auto e = item.cast<std::tuple<double, std::string, decltype(SessionEvent::arguments)>>();
    SessionEvent& event = all.events.emplace_back();
    event.time = std::get<0>(e);
    event.arguments = std::get<2>(e);
    for (std::uint32_t k = 1; k < kEventKinds; ++k)
      if (name_of(static_cast<EventKind>(k)) == std::get<1>(e))
        event.kind = static_cast<EventKind>(k);
    if (event.kind == EventKind::kNone)
      throw py::value_error("'" + std::get<1>(e) + "' is no kind of event");
  }
  all.burs = attributes["event_burs"].cast<std::vector<std::string>>();
  return all;
}

py::array vectors(const std::vector<Vec3>& of) {
  py::array_t<double> out({static_cast<py::ssize_t>(of.size()), py::ssize_t{3}});
  for (std::size_t i = 0; i < of.size(); ++i)
    for (int a = 0; a < 3; ++a) out.mutable_at(static_cast<py::ssize_t>(i), a) = of[i][a];
  return out;
}

py::tuple load_trace(const py::object& path) {
  const std::string name = path_of(path);
  Trace trace;
  run_long(py::none(), [&](Progress&) { trace = read_trace(name); });
  py::dict arrays = arrays_of(trace.rows);
  if (!trace.measured_force.empty()) arrays[kMeasured] = vectors(trace.measured_force);
  if (trace.drive == name_of(Drive::kLoad)) arrays[kApplied] = loads_of(trace.rows);
  if (!trace.bodies.empty()) arrays[kBodyArea] = body_areas_of(trace.rows, trace.bodies);
  return py::make_tuple(arrays, attributes_of(trace));
}

py::dict load_trajectory(const py::object& path) {
  const std::string name = path_of(path);
  Trajectory motion;
  run_long(py::none(), [&](Progress&) { motion = read_trajectory(name); });
  std::vector<StepRecord> rows(motion.samples.size());
  for (std::size_t i = 0; i < rows.size(); ++i) rows[i].handle = motion.samples[i];
  py::dict arrays;
  for (const TraceColumn& column : trace_columns())
    if (column.dataset == std::string("/time") ||
        column.dataset == std::string("/reading_rejected") ||
        std::string(column.dataset).starts_with("/handle/"))
      arrays[py::str(key_of(column))] = column_array(column, rows);
  if (!motion.measured_force.empty()) arrays[kMeasured] = vectors(motion.measured_force);
  if (motion.loaded) arrays[kApplied] = loads_of(rows);
  return arrays;
}

// The column's array out of the dict, as doubles; absent: nothing if it may be.
std::optional<Doubles> taken(const py::dict& arrays, const std::string& key, int width,
                             std::size_t rows, bool required) {
  if (!arrays.contains(key.c_str())) {
    if (required) throw py::key_error("the trace lacks '" + key + "'");
    return {};
  }
  const auto array = Doubles::ensure(arrays[key.c_str()]);
  if (!array) throw py::type_error("'" + key + "' is no array of numbers");
  const bool good = array.ndim() == (width == 1 ? 1 : 2) &&
                    array.shape(0) == static_cast<py::ssize_t>(rows) &&
                    (width == 1 || array.shape(1) == width);
  if (!good)
    throw py::value_error("'" + key + "' must have " + std::to_string(rows) + " rows of " +
                          std::to_string(width));
  return array;
}

void save_trace(const py::dict& arrays, const py::dict& attributes, const py::object& path,
                bool overwrite) {
  Trace trace;
  if (!arrays.contains("time")) throw py::key_error("the trace lacks 'time'");
  trace.rows.resize(py::len(arrays["time"]));
  for (const TraceColumn& column : trace_columns()) {
    const auto values =
        taken(arrays, key_of(column), column.width, trace.rows.size(), column.required);
    if (!values) continue;
    const double* at = values->data();
    for (StepRecord& row : trace.rows) {
      column.set(row, at);
      at += column.width;
    }
  }
  if (const auto measured = taken(arrays, kMeasured, 3, trace.rows.size(), false))
    for (std::size_t i = 0; i < trace.rows.size(); ++i)
      trace.measured_force.emplace_back(Eigen::Map<const Vec3>(measured->data() + 3 * i));
  if (const auto load = taken(arrays, kApplied, 3, trace.rows.size(), false))
    for (std::size_t i = 0; i < trace.rows.size(); ++i)
      trace.rows[i].handle.load = Eigen::Map<const Vec3>(load->data() + 3 * i);
  if (attributes.contains("bodies")) {
    trace.bodies = parse_bodies(attributes["bodies"].cast<std::string>());
    const auto width = static_cast<int>(trace.bodies.size());
    if (const auto areas = taken(arrays, kBodyArea, width, trace.rows.size(), false))
      for (std::size_t i = 0; i < trace.rows.size(); ++i)
        set_body_areas(trace.rows[i], trace.bodies, areas->data() + i * trace.bodies.size());
  }
  trace.toothprep_version = attributes["toothprep_version"].cast<std::string>();
  trace.parameters_toml = attributes["parameters"].cast<std::string>();
  trace.tooth_sha256 = attributes["tooth_sha256"].cast<std::string>();
  trace.bur = attributes["bur"].cast<std::string>();
  trace.drive = attributes["drive"].cast<std::string>();
  trace.engine = attributes["engine"].cast<std::string>();
  trace.initial_overlap_mm3 = attributes["initial_overlap_mm3"].cast<double>();
  trace.audit = {attributes["torque_work_mJ"].cast<double>(),
                 attributes["removed_energy_mJ"].cast<double>(),
                 attributes["energy_ratio"].cast<double>()};
  if (attributes.contains("rows_every"))
    trace.rows_every = attributes["rows_every"].cast<std::size_t>();
  trace.events = events_of(attributes);
  const std::string name = path_of(path);
  run_long(py::none(), [&](Progress&) {
    Outputs outputs(overwrite);
    const std::string file = outputs.file(name, {".h5", ".hdf5"});
    outputs.begin();
    write_trace(trace, file);
    outputs.publish();
  });
}

py::list columns() {
  py::list out;
  for (const TraceColumn& c : trace_columns())
    out.append(py::make_tuple(key_of(c), c.unit, py::cast(c.csv)));
  return out;
}

}  // namespace

py::dict arrays_of(const std::vector<StepRecord>& rows) {
  py::dict arrays;
  for (const TraceColumn& column : trace_columns())
    arrays[py::str(key_of(column))] = column_array(column, rows);
  return arrays;
}

py::array loads_of(const std::vector<StepRecord>& rows) {
  std::vector<Vec3> loads;
  loads.reserve(rows.size());
  for (const StepRecord& row : rows) loads.push_back(row.handle.load);
  return vectors(loads);
}

py::array body_areas_of(const std::vector<StepRecord>& rows, const std::vector<Body>& bodies) {
  py::array_t<double> out(
      {static_cast<py::ssize_t>(rows.size()), static_cast<py::ssize_t>(bodies.size())});
  double* at = out.mutable_data();
  for (const StepRecord& row : rows) {
    get_body_areas(row, bodies, at);
    at += bodies.size();
  }
  return out;
}

void bind_traces(py::module_& m) {
  m.def("load_trace", &load_trace, "(arrays, attributes) of a trace file.");
  m.def("load_trajectory", &load_trajectory, "Arrays of a motion in a file.");
  m.def("save_trace", &save_trace, "Writes arrays and attributes as a trace file.");
  m.def("trace_columns", &columns, "(dataset, unit, columns of the CSV export) of every dataset.");
}

}  // namespace toothprep::python
