#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/tools/files/body_columns.h"
#include "toothprep/tools/files/trace.h"
#include "toothprep/tools/files/trace_columns.h"
#include "toothprep/tools/files/trace_parts.h"

namespace toothprep {
namespace {

using h5::Reader;

constexpr const char* kSchema = "toothprep-trace";
constexpr int kSchemaVersion = 1;
constexpr const char* kMeasured = "/force/measured";
constexpr const char* kApplied = "/force/applied";
constexpr const char* kRejected = "/reading_rejected";
constexpr const char* kRowsEvery = "rows_every";
constexpr double kMostButtons = 4294967295.0;

// What the reader would refuse must not be written.
void check_finite(const std::vector<double>& values, const char* dataset, int width) {
  for (std::size_t i = 0; i < values.size(); ++i)
    if (!std::isfinite(values[i]))
      throw Error(std::string("the trace to be written holds a value that is not finite in ") +
                  dataset + ", row " + std::to_string(i / static_cast<std::size_t>(width)));
}

void check_schema(const Reader& in, bool required) {
  const auto schema = in.text("schema");
  if (!schema && !required) return;
  if (!schema) in.refuse("attribute schema", "is missing: this is not a toothprep trace");
  if (*schema != kSchema) {
    if (!required) return;  // someone else's schema: /time and /handle/position decide
    in.refuse("attribute schema",
              "is '" + h5::printable(*schema) + "', not '" + std::string(kSchema) + "'",
              "this is not a toothprep trace");
  }
  const double version = in.require_number("schema_version");
  if (version != kSchemaVersion && version != kSchemaVersionWithEvents)
    in.refuse("attribute schema_version",
              "is " + h5::printable(std::to_string(version)) + ", this toothprep reads " +
                  std::to_string(kSchemaVersion) + " and " +
                  std::to_string(kSchemaVersionWithEvents),
              "use a newer toothprep");
}

// 1 where the attribute is absent.
std::size_t read_rows_every(const Reader& in) {
  const double every = in.number(kRowsEvery).value_or(1);
  if (!(every >= 1 && every <= kMostSamples && every == std::floor(every)))
    in.refuse(std::string("attribute ") + kRowsEvery, "must be a whole number from 1");
  return static_cast<std::size_t>(every);
}

// Those of the rows up to `last`, s.
SessionEvents read_events(Reader& in, double last) {
  SessionEvents all;
  if (in.number("schema_version").value_or(0) != kSchemaVersionWithEvents) return all;
  std::string burs = in.require_text("event_burs") + '\n';
  for (std::size_t end = 0; (end = burs.find('\n')) != std::string::npos; burs.erase(0, end + 1))
    all.burs.push_back(burs.substr(0, end));
  std::vector<std::vector<double>> columns;
  for (const EventColumn& c : kEventColumns)
    columns.push_back(in.read_table(c.dataset, c.unit, c.width));
  const std::size_t rows =
      std::min({columns[0].size(), columns[1].size(), columns[2].size() / kEventArguments});
  if (!in.growing() && columns[0].size() + columns[1].size() != 2 * rows)
    in.refuse("/events", "its datasets differ in length");
  for (std::size_t i = 0; i < rows && columns[0][i] <= last; ++i) {
    SessionEvent& event = all.events.emplace_back();
    event.time = columns[0][i];
    if (i > 0 && event.time < columns[0][i - 1])
      in.refuse("/events/time, row " + std::to_string(i), "time goes back");
    event.kind = static_cast<EventKind>(
        in.whole_number("/events/kind", i, columns[1][i], 1, kEventKinds - 1));
    std::copy_n(columns[2].begin() + static_cast<std::ptrdiff_t>(i * kEventArguments),
                kEventArguments, event.arguments.begin());
  }
  return all;
}

void write_events(h5::Writer& out, const SessionEvents& all) {
  out.group("/events");
  for (std::size_t c = 0; c < std::size(kEventColumns); ++c) {
    const EventColumn& column = kEventColumns[c];
    std::vector<double> values;
    for (const SessionEvent& event : all.events) {
      double kind = 0;
      const double* v = event_values(event, c, kind);
      values.insert(values.end(), v, v + column.width);
    }
    out.dataset(column.dataset, column.unit, values, column.width, column.storage);
  }
}

std::vector<Body> bodies_of(const Reader& in) {
  const auto text = in.text(kBodyNames);
  if (!text || text->empty()) return {};
  try {
    return parse_bodies(*text);
  } catch (const Error& e) {
    in.refuse(std::string("attribute ") + kBodyNames, h5::printable(e.what()));
  }
}

void read_body_areas(Reader& in, Trace& trace) {
  if (trace.bodies.empty() || !in.has(kBodyAreaName)) return;
  const auto width = trace.bodies.size();
  const std::vector<double> values =
      in.read_unless_trial(in.open(kBodyAreaName, "mm^2", static_cast<int>(width), false));
  for (std::size_t i = 0; i < trace.rows.size(); ++i)
    set_body_areas(trace.rows[i], trace.bodies, values.data() + i * width);
}

bool is_quantity_that_needs_its_unit(const std::string& dataset) {
  return dataset == "/time" || dataset.find("position") != std::string::npos ||
         dataset.find("/force/") == 0;
}

// Empty if the dataset is absent.
std::vector<Vec3> forces(Reader& reader, const char* dataset) {
  std::vector<Vec3> force;
  if (!reader.has(dataset)) return force;
  const std::vector<double> values = reader.read_unless_trial(reader.open(dataset, "N", 3, true));
  force.reserve(values.size() / 3);
  for (std::size_t i = 0; i < values.size(); i += 3)
    force.emplace_back(values[i], values[i + 1], values[i + 2]);
  return force;
}

Trajectory parse_trajectory(Reader& in) {
  check_schema(in, false);
  in.cut_to_shortest({"/time", "/handle/position", "/handle/orientation", "/handle/buttons",
                      kRejected, kMeasured, kApplied});
  const std::vector<double> time = in.read_time();
  if (time.size() < 2) in.refuse("/time", "holds fewer than two samples", "record a motion");
  if (!in.has("/handle/position")) in.refuse("/handle/position", "is missing");
  const std::vector<double> position =
      in.read_unless_trial(in.open("/handle/position", "mm", 3, true));
  Trajectory trajectory;
  trajectory.unfinished = in.growing();
  trajectory.rows_every = read_rows_every(in);
  if (!in.trial()) trajectory.samples.resize(time.size());
  for (std::size_t i = 0; i < trajectory.samples.size(); ++i) {
    trajectory.samples[i].time = time[i];
    trajectory.samples[i].pose.position = Eigen::Map<const Vec3>(position.data() + 3 * i);
  }
  const std::string orientation = "/handle/orientation", buttons = "/handle/buttons";
  if (in.has(orientation)) {
    const std::vector<double> q = in.read_unless_trial(in.open(orientation, "1", 4, false));
    for (std::size_t i = 0; i < trajectory.samples.size(); ++i)
      trajectory.samples[i].pose.orientation = in.quaternion(orientation, i, q.data() + 4 * i);
  }
  if (in.has(buttons)) {
    const std::vector<double> b = in.read_unless_trial(in.open(buttons, "1", 1, false));
    for (std::size_t i = 0; i < trajectory.samples.size(); ++i)
      trajectory.samples[i].buttons =
          static_cast<std::uint32_t>(in.whole_number(buttons, i, b[i], 0, kMostButtons));
  }
  if (in.has(kRejected)) {
    const std::vector<double> rejected = in.read_unless_trial(in.open(kRejected, "1", 1, false));
    for (std::size_t i = 0; i < trajectory.samples.size(); ++i)
      trajectory.samples[i].rejected = in.whole_number(kRejected, i, rejected[i], 0, 1) != 0;
  }
  trajectory.measured_force = forces(in, kMeasured);
  const std::vector<Vec3> load = forces(in, kApplied);
  trajectory.loaded = !load.empty();
  if (!load.empty())
    for (std::size_t i = 0; i < trajectory.samples.size(); ++i)
      trajectory.samples[i].load = load[i];
  trajectory.events = read_events(in, time.back());
  return trajectory;
}

}  // namespace

std::string unfinished_text(const std::string& path) {
  return path +
         ": was not closed (its program was killed, or still runs), so it ends at its last flush";
}

std::string sparse_text(const std::string& path, std::size_t every) {
  return path + ": holds every " + std::to_string(every) +
         "th step only, so what happened in between (peaks, short stalls, turns) isn't in it";
}

Trace every_nth_row(const Trace& trace, std::size_t every) {
  if (every == 0) throw Error("every 0th row can't be kept");
  if (!trace.measured_force.empty() || trace.rows_every != 1)
    throw Error("only a trace of a whole run, without measured forces, can lose rows");
  Trace sparse = trace;
  if (every == 1) return sparse;
  sparse.rows_every = every;
  sparse.rows.clear();
  auto event = trace.events.events.begin();
  for (std::size_t i = 0; i < trace.rows.size(); ++i) {
    const StepRecord& row = trace.rows[i];
    bool changed = false;
    for (; event != trace.events.events.end() && event->time <= row.handle.time; ++event)
      changed = true;
    if (i % every == 0 || changed || i + 1 == trace.rows.size()) sparse.rows.push_back(row);
  }
  return sparse;
}

Trace parse_trace(Reader& in) {
  check_schema(in, true);
  Trace trace;
  trace.toothprep_version = in.require_text("toothprep_version");
  trace.parameters_toml = in.require_text("parameters");
  trace.tooth_sha256 = in.require_text("tooth_sha256");
  // A session's audit is done at its end.
  const auto audit = [&](const char* name) {
    return in.growing() ? in.number(name).value_or(std::nan("")) : in.require_number(name);
  };
  trace.audit.torque_work_mj = audit("torque_work_mJ");
  trace.audit.removed_energy_mj = audit("removed_energy_mJ");
  trace.audit.energy_ratio = audit("energy_ratio");
  trace.bur = in.text("bur").value_or("");
  trace.unfinished = in.growing();
  trace.rows_every = read_rows_every(in);
  trace.drive = in.text("drive").value_or("");
  trace.engine = in.text("engine").value_or("");
  trace.initial_overlap_mm3 = in.number("initial_overlap_mm3").value_or(0.0);

  trace.bodies = bodies_of(in);
  std::vector<std::string> names = {kMeasured, kApplied, kBodyAreaName};
  for (const TraceColumn& column : trace_columns()) names.emplace_back(column.dataset);
  in.cut_to_shortest(names);
  // Shapes, types and units of all before the rows are allocated.
  const std::vector<double> time = in.read_time();
  std::vector<std::pair<const TraceColumn*, Reader::Set>> sets;
  for (const TraceColumn& column : trace_columns()) {
    if (!in.has(column.dataset)) {
      if (column.required) in.refuse(column.dataset, "is missing");
      continue;
    }
    sets.emplace_back(&column,
                      in.open(column.dataset, column.unit, column.width,
                              is_quantity_that_needs_its_unit(column.dataset), column.per_tissue));
  }
  if (!in.trial()) trace.rows.resize(time.size());
  for (const auto& [column, set] : sets) {
    const std::vector<double> values = in.read_unless_trial(set);
    const auto width = static_cast<std::size_t>(set.width);
    for (std::size_t i = 0; i < trace.rows.size(); ++i) {
      const double* v = values.data() + i * width;
      std::array<double, 4> row{};
      for (std::size_t c = 0; c < width; ++c)
        row[column->per_tissue ? static_cast<std::size_t>(set.tissues[c]) : c] = v[c];
      if (column->width == 4 && !column->per_tissue) {
        const Quat q = in.quaternion(set.name, i, v);
        for (int c = 0; c < 4; ++c) row[static_cast<std::size_t>(c)] = q.coeffs()[c];
      }
      if (column->storage == Storage::kUint32) in.whole_number(set.name, i, v[0], 0, kMostButtons);
      if (column->storage == Storage::kUint8 && v[0] != 0 && v[0] != 1)
        in.refuse(set.name + ", row " + std::to_string(i), "must be 0 or 1");
      column->set(trace.rows[i], row.data());
    }
  }
  read_body_areas(in, trace);
  trace.measured_force = forces(in, kMeasured);
  const std::vector<Vec3> load = forces(in, kApplied);
  if (!load.empty())
    for (std::size_t i = 0; i < trace.rows.size(); ++i) trace.rows[i].handle.load = load[i];
  trace.events = read_events(in, time.back());
  return trace;
}

const double* event_values(const SessionEvent& event, std::size_t column, double& kind) {
  kind = static_cast<double>(event.kind);
  return column == 0 ? &event.time : column == 1 ? &kind : event.arguments.data();
}

std::string joined(const std::vector<std::string>& lines) {
  std::string text;
  for (const std::string& line : lines) text += (text.empty() ? "" : "\n") + line;
  return text;
}

std::vector<std::string> tissue_columns() { return {kTissueNames.begin(), kTissueNames.end()}; }

void write_trace_head(h5::Writer& out, const Trace& trace) {
  out.text("schema", kSchema);
  const bool changed = !trace.events.events.empty();
  out.integer("schema_version", changed ? kSchemaVersionWithEvents : kSchemaVersion);
  if (!trace.events.burs.empty()) out.text("event_burs", joined(trace.events.burs));
  out.text("toothprep_version", trace.toothprep_version);
  out.text("parameters", trace.parameters_toml);
  out.text("tooth_sha256", trace.tooth_sha256);
  out.text("bur", trace.bur);
  out.text("drive", trace.drive);
  out.text("engine", trace.engine);
  out.number("initial_overlap_mm3", trace.initial_overlap_mm3);
  out.number("torque_work_mJ", trace.audit.torque_work_mj);
  out.number("removed_energy_mJ", trace.audit.removed_energy_mj);
  out.number("energy_ratio", trace.audit.energy_ratio);
  if (!trace.bodies.empty()) out.text(kBodyNames, bodies_text(trace.bodies));
  if (trace.rows_every > 1) out.integer(kRowsEvery, static_cast<std::int64_t>(trace.rows_every));

  for (const char* group : {"/handle", "/bur", "/force", "/contact", "/removed"}) out.group(group);
}

void write_trace(const Trace& trace, const std::string& path) {
  if (trace.rows.empty()) throw Error(path + ": a trace without rows cannot be written");
  if (!trace.measured_force.empty() && trace.measured_force.size() != trace.rows.size())
    throw Error(path + ": the trace has not as many measured forces as rows");
  const auto lock = h5::lock_hdf5();
  const h5::Quiet quiet;
  h5::Writer out(path);
  write_trace_head(out, trace);
  const std::vector<std::string> tissues = tissue_columns();
  std::vector<double> values;
  for (const TraceColumn& column : trace_columns()) {
    const auto width = static_cast<std::size_t>(column.width);
    values.resize(trace.rows.size() * width);
    for (std::size_t i = 0; i < trace.rows.size(); ++i)
      column.get(trace.rows[i], values.data() + i * width);
    check_finite(values, column.dataset, column.width);
    out.dataset(column.dataset, column.unit, values, column.width, column.storage,
                column.per_tissue ? tissues : std::vector<std::string>{});
  }
  if (!trace.bodies.empty()) {
    const std::size_t width = trace.bodies.size();
    values.resize(trace.rows.size() * width);
    for (std::size_t i = 0; i < trace.rows.size(); ++i)
      get_body_areas(trace.rows[i], trace.bodies, values.data() + i * width);
    check_finite(values, kBodyAreaName, static_cast<int>(width));
    out.dataset(kBodyAreaName, "mm^2", values, static_cast<int>(width), Storage::kDouble,
                names_of(trace.bodies), kBodyNames);
  }
  const auto write_forces = [&](const char* dataset, const auto& force) {
    values.resize(trace.rows.size() * 3);
    for (std::size_t i = 0; i < trace.rows.size(); ++i)
      Eigen::Map<Vec3>(values.data() + 3 * i, 3) = force(i);
    check_finite(values, dataset, 3);
    out.dataset(dataset, "N", values, 3, Storage::kDouble);
  };
  if (!trace.measured_force.empty())
    write_forces(kMeasured, [&](std::size_t i) { return trace.measured_force[i]; });
  if (trace.drive == name_of(Drive::kLoad))
    write_forces(kApplied, [&](std::size_t i) { return trace.rows[i].handle.load; });
  if (!trace.events.events.empty()) write_events(out, trace.events);
  out.close();
}

Trace read_trace(const std::string& path, ReadPolicy policy) {
  return h5::read_with_care(path, policy, parse_trace);
}

bool is_trace_file(const std::string& path, ReadPolicy policy) {
  return h5::read_with_care(
      path, policy, [](Reader& in) { return in.text("schema") == kSchema; }, h5::Extent::kGlance);
}

bool holds_trajectory(const std::string& path, ReadPolicy policy) {
  return h5::read_with_care(
      path, policy, [](Reader& in) { return in.has("/time") && in.has("/handle/position"); });
}

Trajectory read_h5_trajectory(const std::string& path, ReadPolicy policy) {
  return h5::read_with_care(path, policy, parse_trajectory);
}

}  // namespace toothprep
