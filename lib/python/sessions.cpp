// Sessions: a bur on a tooth, stepped one pose or one path at a time.
#include <fmt/format.h>

#include <atomic>
#include <cmath>
#include <limits>
#include <optional>

#include "bindings.h"
#include "long_work.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/grinding/engine.h"
#include "toothprep/step/grinding/workpiece.h"
#include "toothprep/step/session/body_warnings.h"
#include "toothprep/step/session/plausibility.h"
#include "toothprep/step/session/run_warnings.h"
#include "toothprep/step/session/session.h"
#include "toothprep/tools/files/trace_columns.h"
#include "toothprep/tools/trajectory/trajectory.h"
#include "toothprep/version.h"

namespace toothprep::python {
namespace {

constexpr double kSamePlace = 1e-6;          // mm, and of a quaternion's components
constexpr std::size_t kStepsPerReport = 64;  // of a run

Vec3 position_of(const py::object& given) {
  const auto p = given.is_none() ? Doubles() : Doubles::ensure(given);
  if (given.is_none() || !p) throw py::type_error("a position is three numbers, mm");
  if (p.ndim() != 1 || p.shape(0) != 3)
    throw py::value_error("a position is three numbers (x, y, z), mm");
  Vec3 position(p.data()[0], p.data()[1], p.data()[2]);
  if (!position.allFinite()) throw py::value_error("the position is not finite");
  return position;
}

Quat checked_quaternion(const double* v, const std::string& what) {
  Quat q;
  if (!accept_quaternion(Quat(v[3], v[0], v[1], v[2]), q))
    throw py::value_error(what + " is no unit quaternion (x, y, z, w)");
  return q;
}

Quat orientation_of(const py::object& given) {
  const auto q = Doubles::ensure(given);
  if (!q) throw py::type_error("an orientation is four numbers (x, y, z, w)");
  if (q.ndim() != 1 || q.shape(0) != 4)
    throw py::value_error("an orientation is four numbers (x, y, z, w)");
  return checked_quaternion(q.data(), "the orientation");
}

std::uint32_t buttons_of(long long value) {
  if (value < 0 || value > std::numeric_limits<std::uint32_t>::max()) {
    PyErr_SetString(PyExc_OverflowError, "buttons are bits, 0 to 4294967295");
    throw py::error_already_set();
  }
  return static_cast<std::uint32_t>(value);
}

Drive drive_of(const std::string& name) {
  if (const auto drive = drive_named(name)) return *drive;
  throw py::value_error("drive is 'coupled', 'direct' or 'load', not '" + name + "'");
}

bool same_place(const Pose& a, const Pose& b) {
  return (a.position - b.position).cwiseAbs().maxCoeff() <= kSamePlace &&
         (a.orientation.coeffs() - b.orientation.coeffs()).cwiseAbs().maxCoeff() <= kSamePlace;
}

bool same_bits(const HandleSample& a, const HandleSample& b) {
  return a.time == b.time && a.buttons == b.buttons && a.pose.position == b.pose.position &&
         a.pose.orientation.coeffs() == b.pose.orientation.coeffs();
}

// One session at work at a time; RuntimeError for a second call from another thread.
class Turn {
 public:
  explicit Turn(std::atomic<bool>& busy) : busy_(busy) {
    if (busy_.exchange(true))
      throw std::runtime_error("this session is at work on another thread; make one each");
  }
  ~Turn() { busy_ = false; }
  Turn(const Turn&) = delete;
  Turn& operator=(const Turn&) = delete;

 private:
  std::atomic<bool>& busy_;
};

class SessionObject {
 public:
  SessionObject(SharedTooth tooth, SharedBur bur, const Parameters& parameters, Drive drive,
                const std::optional<Pose>& start, const Quat& orientation)
      : tooth_(std::move(tooth)), bur_(std::move(bur)), parameters_(parameters), drive_(drive) {
    handle_.pose.orientation = orientation;
    if (parameters_.engine == EngineKind::kLevelset)
      static_cast<void>(element_size(bur_->bur, parameters_));  // throws if it does not fit
    if (start) begin(HandleSample{0, *start, kPedalButton});
  }

  StepRecord step(const Vec3& position, const std::optional<Quat>& orientation,
                  std::uint32_t buttons, const std::optional<Vec3>& load) {
    const Turn turn(busy_);
    check_load(load.has_value());
    HandleSample next;
    next.load = load.value_or(Vec3::Zero());
    next.pose.position = position;
    next.pose.orientation = orientation.value_or(handle_.pose.orientation);
    next.buttons = buttons;
    if (!session_) {  // without a position to start from, the first sample is the start
      begin(next);
      return last_;
    }
    ++steps_;
    next.time = start_time_ + static_cast<double>(steps_) * parameters_.time_step;
    make_step(next);
    return last_;
  }

  // Rows as replay() makes them: the first is the start.
  std::vector<StepRecord> run(const std::vector<HandleSample>& path, Progress& progress) {
    const Turn turn(busy_);
    arrive(path.front());
    std::vector<StepRecord> rows;
    rows.reserve(path.size());
    last_.handle.load = path.front().load;
    rows.push_back(last_);
    start_time_ = path.front().time;
    for (steps_ = 0; steps_ + 1 < path.size();) {
      make_step(path[steps_ + 1]);
      rows.push_back(last_);
      ++steps_;
      if (ran_off()) break;
      if (steps_ % kStepsPerReport == 0)
        progress.report("run", static_cast<double>(steps_) / static_cast<double>(path.size()));
    }
    session_->finish(rows.back());
    last_ = rows.back();
    return rows;
  }

  // Drive `load`: the bur has gone too far without contact.
  bool ran_off() const {
    return drive_ == Drive::kLoad && totals().way_without_contact > kMostWayWithoutContact;
  }
  void check_load(bool given) const {
    if (given == (drive_ == Drive::kLoad)) return;
    throw py::value_error(given ? "a load is for sessions with drive='load'"
                                : "a session with drive='load' needs the load (x, y, z), N");
  }

  StepRecord finish() {
    const Turn turn(busy_);
    if (session_) session_->finish(last_);
    return last_;
  }

  LayeredTooth remaining() {
    const Turn turn(busy_);
    LayeredTooth left = tooth_->layers;
    if (workpiece_) apply_cut(left, *workpiece_);
    return left;
  }

  double removed_energy() const {
    const SessionTotals now = totals();
    return energy_of_removal(parameters_, now, now.removed);  // N·mm = mJ
  }
  SessionTotals totals() const { return session_ ? session_->totals() : SessionTotals(); }
  const Tooth& tooth() const { return *tooth_; }
  const BurObject& bur() const { return *bur_; }
  const Parameters& parameters() const { return parameters_; }
  Drive drive() const { return drive_; }
  const Quat& orientation() const { return handle_.pose.orientation; }
  std::size_t all_steps() const { return all_steps_; }

 private:
  void make_step(const HandleSample& next) {
    last_ = session_->step(next);
    if (!next.rejected) handle_ = next;
    ++all_steps_;
  }

  void begin(const HandleSample& first) {
    if (first.rejected) throw py::value_error("the first sample must not be rejected");
    auto workpiece = std::make_unique<Workpiece>(tooth_->layers);
    session_ = std::make_unique<Session>(bur_->bur, *workpiece, parameters_, drive_, first);
    workpiece_ = std::move(workpiece);
    last_ = session_->initial();
    handle_ = first;
  }

  // A run goes on from where the session stands; if it has made no step yet, from that very sample.
  void arrive(const HandleSample& first) {
    if (session_ && !same_place(handle_.pose, first.pose)) {
      const Vec3& at = handle_.pose.position;
      throw py::value_error(fmt::format(
          "the path begins at ({:.6g}, {:.6g}, {:.6g}) but the handle is at ({:.6g}, {:.6g}, "
          "{:.6g}), or turned otherwise: row 0 is the start, so begin the path there, or give "
          "Session the path's first position and orientation",
          first.pose.position.x(), first.pose.position.y(), first.pose.position.z(), at.x(), at.y(),
          at.z()));
    }
    if (!session_ || (all_steps_ == 0 && !same_bits(handle_, first))) begin(first);
    last_.handle.time = first.time;
  }

  SharedTooth tooth_;
  SharedBur bur_;
  Parameters parameters_;
  Drive drive_;
  HandleSample handle_;  // the last one that was not rejected
  std::unique_ptr<Workpiece> workpiece_;
  std::unique_ptr<Session> session_;  // after the workpiece, to which it refers
  StepRecord last_;
  double start_time_ = 0;                  // s, of the last run or of the session
  std::size_t steps_ = 0, all_steps_ = 0;  // since start_time_, and of the session
  std::atomic<bool> busy_{false};
};

std::shared_ptr<SessionObject> make(const std::shared_ptr<Tooth>& tooth, const py::object& bur,
                                    const py::object& parameters, const std::string& drive,
                                    const py::object& position, const py::object& orientation) {
  if (!tooth) throw py::type_error("a session needs a Tooth");
  const Quat turned = orientation_of(orientation);
  std::optional<Pose> start;
  if (!position.is_none()) start = Pose{position_of(position), turned};
  const SharedBur tool = bur_of(bur);
  const Parameters model = parameters_of(parameters);
  const Drive how = drive_of(drive);
  const py::gil_scoped_release released;
  return std::make_shared<SessionObject>(tooth, tool, model, how, start, turned);
}

std::string shape_text(const py::array& a) {
  std::string text = "(";
  for (py::ssize_t d = 0; d < a.ndim(); ++d)
    text += (d ? ", " : "") + std::to_string(a.shape(d)) + (a.ndim() == 1 ? "," : "");
  return text + ")";
}

Doubles rows_of(const py::object& given, const char* name, py::ssize_t rows, py::ssize_t width) {
  auto array = Doubles::ensure(given);
  if (!array) throw py::type_error(std::string(name) + " is no array of numbers");
  const bool good = width == 0 ? array.ndim() == 1 : array.ndim() == 2 && array.shape(1) == width;
  if (!good || (rows >= 0 && array.shape(0) != rows))
    throw py::value_error(fmt::format(
        "{} must have the shape ({}{}), not {}", name, rows < 0 ? "T" : std::to_string(rows),
        width == 0 ? "," : ", " + std::to_string(width), shape_text(array)));
  for (py::ssize_t i = 0; i < array.size(); ++i)
    if (!std::isfinite(array.data()[i]))
      throw py::value_error(std::string(name) + " holds a value that is not finite");
  return array;
}

// (3,) for all rows, or a row each; N.
Doubles load_taken(const py::object& given, py::ssize_t rows) {
  const auto one = Doubles::ensure(given);
  return one && one.ndim() == 1 ? rows_of(given, "load", 3, 0) : rows_of(given, "load", rows, 3);
}

// The path as it was given, one sample a row.
Trajectory trajectory_of(const py::object& time, const py::object& position,
                         const py::object& orientation, const py::object& buttons,
                         const py::object& rejected, const py::object& load, const Quat& held) {
  const Doubles t = rows_of(time, "time", -1, 0);
  const py::ssize_t rows = t.shape(0);
  if (rows < 2) throw py::value_error("a path needs at least two samples");
  const Doubles p = rows_of(position, "position", rows, 3);
  std::optional<Doubles> q, b, r, f;
  if (!orientation.is_none()) q = rows_of(orientation, "orientation", rows, 4);
  if (!buttons.is_none()) b = rows_of(buttons, "buttons", rows, 0);
  if (!rejected.is_none()) r = rows_of(rejected, "rejected", rows, 0);
  if (!load.is_none()) f = load_taken(load, rows);
  Trajectory path;
  path.loaded = f.has_value();
  path.samples.resize(static_cast<std::size_t>(rows));
  for (py::ssize_t i = 0; i < rows; ++i) {
    HandleSample& s = path.samples[static_cast<std::size_t>(i)];
    s.time = t.data()[i];
    s.pose.position = Eigen::Map<const Vec3>(p.data() + 3 * i);
    s.pose.orientation =
        q ? checked_quaternion(q->data() + 4 * i, fmt::format("orientation[{}]", i)) : held;
    s.rejected = r && r->data()[i] != 0;
    if (f) s.load = Eigen::Map<const Vec3>(f->data() + (f->ndim() == 2 ? 3 * i : 0));
    if (!b) continue;
    if (b->data()[i] != std::floor(b->data()[i]))
      throw py::type_error("buttons are whole numbers (bits)");
    s.buttons = buttons_of(static_cast<long long>(
        std::clamp(b->data()[i], -1.0, 1.0 + std::numeric_limits<std::uint32_t>::max())));
  }
  return path;
}

double energy_ratio(const SessionObject& s) {
  const double energy = s.removed_energy();
  return energy > 0 ? s.totals().torque_work / energy : std::numeric_limits<double>::quiet_NaN();
}

double overlap_of(const SessionTotals& totals) {
  double sum = 0;
  for (const double v : totals.initial_overlap) sum += v;
  return sum;
}

py::dict bodies_of(const std::vector<Body>& list, const SessionTotals& totals) {
  py::dict all;
  for (std::size_t b = 0; b < list.size(); ++b) {
    const BodyTotals& t = totals.bodies[b];
    py::dict d;
    d["kind"] = std::string(kBodyKindNames[static_cast<std::size_t>(list[b].kind)]);
    d["contact_steps"] = t.contact_steps;
    d["shank_contact_steps"] = t.shank_contact_steps;
    d["removed_mm3"] = t.removed;
    d["first_removal_s"] = t.first_removal;
    all[py::str(list[b].name)] = d;
  }
  return all;
}

py::dict totals_of(const SessionObject& s) {
  const SessionTotals t = s.totals();
  py::dict d;
  d["steps"] = s.all_steps();
  d["peak_force_n"] = t.peak_device_force;
  d["largest_lag_mm"] = t.largest_lag;
  d["stalled_steps"] = t.stalled_steps;
  d["stall_onsets"] = t.stall_onsets;
  d["split_steps"] = t.split_steps;
  d["split_steps_cut_short"] = t.split_steps_cut_short;
  d["contact_steps"] = t.contact_steps;
  d["rejected_steps"] = t.rejected_steps;
  d["shank_contact_steps"] = t.shank_contact_steps;
  d["removed_mm3"] = by_tissue(t.removed);
  if (!t.bodies.empty()) d["bodies"] = bodies_of(s.tooth().layers.bodies->list, t);
  d["initial_overlap_mm3"] = overlap_of(t);
  d["torque_work_mj"] = t.torque_work;
  d["removed_energy_mj"] = s.removed_energy();
  d["energy_ratio"] = energy_ratio(s);
  return d;
}

py::dict attributes_of(const SessionObject& s, const std::string& tooth_hash) {
  py::dict a;
  a["toothprep_version"] = kVersion;
  a["parameters"] = to_toml(s.parameters());
  a["tooth_sha256"] = tooth_hash;
  a["bur"] = s.bur().spec;
  a["drive"] = name_of(s.drive());
  a["engine"] = name_of(s.parameters().engine);
  a["initial_overlap_mm3"] = overlap_of(s.totals());
  a["torque_work_mJ"] = s.totals().torque_work;
  a["removed_energy_mJ"] = s.removed_energy();
  a["energy_ratio"] = energy_ratio(s);
  if (const auto& bodies = s.tooth().layers.bodies) a["bodies"] = bodies_text(bodies->list);
  return a;
}

// What `replay` warns of, too.
std::vector<std::string> judge(const SessionObject& s, const Trajectory& given,
                               const std::vector<StepRecord>& rows) {
  std::vector<Finding> findings = judge_motion(without_rejected(given).samples, s.drive());
  for (Finding& f : judge_parameters(s.parameters())) findings.push_back(std::move(f));
  const SessionTotals t = s.totals();
  const Audit audit = judge_audit(t.torque_work, s.removed_energy(), t.removed, s.parameters());
  std::vector<std::string> texts;
  for (const Finding& f :
       judge_run(std::move(findings), audit, t.peak_device_force, t.largest_lag, s.drive()))
    texts.push_back("path: " + message_of(f));
  for (std::string& text : outcome_warnings(rows, s.bur().bur, s.tooth().layers))
    texts.push_back(std::move(text));
  if (const auto& bodies = s.tooth().layers.bodies)
    for (std::string& text : body_warnings(t, bodies->list)) texts.push_back(std::move(text));
  if (s.ran_off())
    texts.push_back(
        fmt::format("path: the bur left the tooth and went {:g} mm without contact; "
                    "the run ends there, at {:.3f} s",
                    kMostWayWithoutContact, rows.back().handle.time));
  for (std::string& text : run_warnings(t, s.drive())) texts.push_back(std::move(text));
  return texts;
}

py::object run(SessionObject& s, const py::object& time, const py::object& position,
               const py::object& orientation, const py::object& buttons, const py::object& rejected,
               const py::object& load, bool allow_gaps, const py::object& progress) {
  s.check_load(!load.is_none());
  const Trajectory given =
      trajectory_of(time, position, orientation, buttons, rejected, load, s.orientation());
  std::vector<StepRecord> rows;
  std::vector<std::string> warnings;
  std::string hash;
  const py::object callback = py::module_::import("toothprep._progress").attr("callback")(progress);
  run_long(callback, [&](Progress& reporting) {
    check_run_memory("path", given, s.parameters().time_step);
    rows = s.run(resample(given, s.parameters().time_step, allow_gaps, "path"), reporting);
    if (s.ran_off() && s.totals().contact_steps == 0)
      throw InputError("path", "row 0",
                       fmt::format("a bur that starts there goes {:g} mm under this load without "
                                   "touching the tooth",
                                   kMostWayWithoutContact),
                       "start it at the tooth, and push it towards the tooth");
    warnings = judge(s, given, rows);
    hash = tooth_sha256(s.tooth().layers);
  });
  warn(warnings);
  py::dict arrays = arrays_of(rows);
  if (given.loaded) arrays["force/applied"] = loads_of(rows);
  if (const auto& bodies = s.tooth().layers.bodies)
    arrays["contact/body_area"] = body_areas_of(rows, bodies->list);
  return py::module_::import("toothprep._trace").attr("Trace")(arrays, attributes_of(s, hash));
}

// A row's fields under the datasets' names, "/force/device" as force_device.
void bind_record(py::module_& m) {
  py::class_<StepRecord> type(
      m, "Record",
      "The state after a step: a row of a trace. Forces on the bur and positions in W.");
  for (const TraceColumn& column : trace_columns()) {
    std::string name = std::string(column.dataset).substr(1);
    std::replace(name.begin(), name.end(), '/', '_');
    const std::string shape = column.width == 1 ? "a number" : fmt::format("({},)", column.width);
    const std::string doc =
        fmt::format("{} of the trace, {}, unit {}{}.", column.dataset, shape, column.unit,
                    column.per_tissue ? ", by enamel, dentin, pulp, other" : "");
    type.def_property_readonly(
        name.c_str(),
        [&column](const StepRecord& row) -> py::object {
          std::vector<double> values(static_cast<std::size_t>(column.width));
          column.get(row, values.data());
          if (column.width > 1) return array_from(values, {column.width});
          if (column.storage == Storage::kUint8) return py::bool_(values[0] != 0);
          if (column.storage == Storage::kUint32)
            return py::int_(static_cast<std::uint32_t>(values[0]));
          return py::float_(values[0]);
        },
        py::return_value_policy::move, doc.c_str());
  }
  type.def("__repr__", [](const StepRecord& r) {
    const Vec3& p = r.bur.position;
    return fmt::format(
        "<toothprep.Record at {:.6g} s: bur at ({:.4g}, {:.4g}, {:.4g}) mm, device "
        "force {:.4g} N{}>",
        r.handle.time, p.x(), p.y(), p.z(), r.device_force.norm(), r.stalled ? ", stalled" : "");
  });
}

void bind_session_figures(py::class_<SessionObject, std::shared_ptr<SessionObject>>& type) {
  type.def_property_readonly(
      "totals", &totals_of,
      "What the session has counted, a dict with the keys of `replay --json`: steps, peak_force_n, "
      "largest_lag_mm, stalled_steps, removed_mm3 (a dict by tissue), torque_work_mj, "
      "removed_energy_mj, energy_ratio (NaN while nothing is removed) and others.");
  type.def_property_readonly(
      "drive", [](const SessionObject& s) { return name_of(s.drive()); },
      "'coupled', 'direct' or 'load'.");
  type.def_property_readonly(
      "time_step_s", [](const SessionObject& s) { return s.parameters().time_step; },
      "Length of a step, s.");
  type.def(
      "remaining",
      [](SessionObject& s) {
        const py::gil_scoped_release released;
        return std::make_shared<Tooth>(s.remaining());
      },
      "What remains of the tooth, as a new Tooth. The session's own tooth never changes.");
  type.def(
      "remaining_mesh",
      [](SessionObject& s) {
        TriangleMesh mesh;
        {
          const py::gil_scoped_release released;
          mesh = extract_surface(s.remaining(), SurfaceOf::kAll);
        }
        return arrays_of(mesh);
      },
      "The closed surface of what remains: a dict of vertices (V, 3) float32, mm, W; triangles "
      "(T, 3) uint32, counter-clockwise seen from outside; tissue (V,) uint8.");
}

}  // namespace

void bind_sessions(py::module_& m) {
  bind_record(m);
  py::class_<SessionObject, std::shared_ptr<SessionObject>> type(
      m, "Session",
      "A bur on a tooth. The tooth itself never changes: a session cuts a copy, see remaining(). "
      "Sessions on several threads run side by side, also on one tooth; one session serves one "
      "thread at a time (RuntimeError otherwise).");
  type.def(
      py::init(&make), py::arg("tooth"), py::arg("bur"), py::arg("parameters") = py::none(),
      py::arg("drive") = "coupled", py::arg("position") = py::none(),
      py::arg("orientation") = py::make_tuple(0, 0, 0, 1),
      "tooth: a Tooth. bur: a Bur, or what Bur() takes. parameters: a dict shaped as the "
      "parameter file, a path, a preset's name; None: 'paper'. drive: 'coupled' (the bur "
      "follows the handle by a spring), 'direct' (the handle moves the bur) or 'load' (a force "
      "pushes it; the handle turns it, and its position counts at the start alone).\n\n"
      "position (3,), mm, W, and orientation (4,), x, y, z, w, taking B to W: where the bur's "
      "tip starts; tissue inside the bur there is removed. Without a position the session "
      "starts where its first sample is.\n\n"
      "Raises Error for parameters out of range and a bur too thin for the voxels, ValueError "
      "and TypeError for wrong arguments.");
  type.def(
      "step",
      [](SessionObject& s, const py::object& position, const py::object& orientation,
         long long buttons, const py::object& load) {
        std::optional<Quat> turned;
        if (!orientation.is_none()) turned = orientation_of(orientation);
        std::optional<Vec3> force;
        if (!load.is_none()) force = Eigen::Map<const Vec3>(load_taken(load, 1).data());
        return s.step(position_of(position), turned, buttons_of(buttons), force);
      },
      py::arg("position"), py::arg("orientation") = py::none(), py::arg("buttons") = 1,
      py::kw_only(), py::arg("load") = py::none(),
      "One step of time_step_s that ends with the handle at position (3,), mm, W; returns its "
      "Record. orientation (4,): None keeps the last one. buttons: bit 0 is the motor. load (3,), "
      "N, "
      "W: the force on the bur, for drive='load' alone.\n\n"
      "ValueError, TypeError and OverflowError for wrong arguments; the session is then as "
      "before.");
  type.def(
      "run", &run, py::arg("time"), py::arg("position"), py::arg("orientation") = py::none(),
      py::arg("buttons") = py::none(), py::kw_only(), py::arg("rejected") = py::none(),
      py::arg("load") = py::none(), py::arg("allow_gaps") = false, py::arg("progress") = py::none(),
      "A path of the handle through the session; returns a Trace, a dict of the trace's datasets "
      "('force/device', ...) as arrays. The same bits as `toothprep replay` of that path. Row 0 is "
      "the start: the path must begin where the session stands.\n\n"
      "time (T,), s, increasing; position (T, 3), mm, W; orientation (T, 4), x, y, z, w, None "
      "keeps "
      "the session's; buttons (T,), bits, None: motor on; rejected (T,), not 0 where a reading "
      "can't "
      "be believed and no step is made; load (3,) or (T, 3), N, W, for drive='load' alone: the run "
      "then ends early where the bur has gone 5 mm without contact. A path that is not at the "
      "session's step "
      "is resampled (linear, slerp) as replay does; gaps above 0.1 s raise Error unless "
      "allow_gaps.\n\n"
      "progress: True for a line on stderr, or a function called as progress(stage, done). The GIL "
      "is released. Ctrl-C ends the run between two steps; the session then stands there. "
      "Implausible "
      "values (units, speeds, the energy audit), stalls in direct drive and contact of the "
      "shank are UserWarnings, as replay warns of them.");
  type.def("finish", &SessionObject::finish,
           "Removes what is still due (removal goes by the voxel) and returns the last Record with "
           "its volumes brought up to date. run() does this at its end; after single steps call it "
           "before reading totals.");
  bind_session_figures(type);
}

}  // namespace toothprep::python
