// toothprep replay: a trajectory through force, coupling, stall and removal; a trace and the
// prepared tooth.
#include "toothprep/step/session/replay.h"

#include <fmt/format.h>
#include <tbb/parallel_invoke.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "body_figures.h"
#include "command.h"
#include "placing.h"
#include "session_options.h"
#include "strictness.h"
#include "toothprep/build_info.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/grinding/engine.h"
#include "toothprep/step/session/body_warnings.h"
#include "toothprep/step/session/run_warnings.h"
#include "toothprep/tools/files/framed_trajectory_file.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/files/trace.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/mesh/tissue_division.h"
#include "toothprep/tools/models/model_file.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kFarFromTooth = 5.0;     // mm
constexpr double kMostBetweenRows = 0.1;  // s: readers of trajectories refuse larger gaps

struct Options {
  SessionOptions session;
  PlacingOptions placing;
  std::string trajectory, output, prepared, mesh;
  bool force = false, json = false, strict = false, allow_gaps = false;
  std::size_t trace_every = 1;
};

// Of the force on the hand while the bur touched tissue: in air it is the coupling's alone, which
// pulls the bur's mass along. None if it never touched.
std::optional<double> peak_force_in_contact(const std::vector<StepRecord>& rows) {
  std::optional<double> peak;
  for (const StepRecord& row : rows)
    if (row.stalled || std::any_of(row.contact_area.begin(), row.contact_area.end(),
                                   [](double area) { return area > 0; }))
      peak = std::max(peak.value_or(0), row.device_force.norm());
  return peak;
}

Json report_json(const ReplayResult& r, const Trace& trace, const Options& o, const Audit& audit,
                 const std::vector<Finding>& findings, const std::optional<double>& element_mm,
                 const std::optional<double>& touching, const std::vector<std::string>& outcome) {
  Json j;
  j["schema"] = "toothprep-replay";
  j["toothprep_version"] = kVersion;
  j["build"] = build_text();
  j["steps"] = trace.rows.size() - 1;
  j["seconds_simulated"] = r.seconds_simulated;
  j["realtime_factor"] = r.seconds_simulated / r.seconds_computed;
  j["step_us_p50"] = r.step_us_p50;
  j["step_us_p99"] = r.step_us_p99;
  j["step_us_max"] = r.step_us_max;
  j["drive"] = trace.drive;
  j["engine"] = trace.engine;
  if (element_mm) j["element_mm"] = *element_mm;
  j["bur"] = trace.bur;
  j["peak_force_n"] = r.totals.peak_device_force;
  j["peak_force_in_contact_n"] = touching ? Json(*touching) : Json(nullptr);
  j["largest_lag_mm"] = r.totals.largest_lag;
  j["stalled_steps"] = r.totals.stalled_steps;
  j["stall_onsets"] = r.totals.stall_onsets;
  if (o.session.drive == name_of(Drive::kLoad)) {
    j["ran_off"] = r.ran_off;
    j["unbalanced_steps"] = r.totals.unbalanced_steps;
  }
  j["split_steps"] = r.totals.split_steps;
  j["split_steps_cut_short"] = r.totals.split_steps_cut_short;
  j["rejected_steps"] = r.totals.rejected_steps;
  j["contact_steps"] = r.totals.contact_steps;
  j["shank_contact_steps"] = r.totals.shank_contact_steps;
  double overlap = 0;
  for (int k = 0; k < kTissueCount; ++k) {
    j["removed_mm3"][std::string(kTissueNames[k])] = r.totals.removed[k];
    overlap += r.totals.initial_overlap[k];
  }
  put_bodies(j, trace.bodies, r.totals);
  j["initial_overlap_mm3"] = overlap;
  j["torque_work_mj"] = r.totals.torque_work;
  j["removed_energy_mj"] = r.removed_energy;
  j["energy_ratio"] = std::isfinite(r.energy_ratio) ? Json(r.energy_ratio) : Json(nullptr);
  j["outcome"] = outcome;
  put_judgement(j, audit, findings);
  j["tooth_sha256"] = trace.tooth_sha256;
  j["trajectory_sha256"] = sha256_of_file(o.trajectory);
  return j;
}

// The share that is done, on a terminal.
struct Progress {
  int last = -1;
  void operator()(double done) {
    if (static_cast<int>(done * 100) == last) return;
    last = static_cast<int>(done * 100);
    std::fprintf(stderr, "\rreplay %3d %%", last);
  }
};

Trajectory put_on_tooth(Trajectory path, PathFrame frame, const LayeredTooth& tooth,
                        const Options& o, const Common& common) {
  PlacedPath result =
      place_path(std::move(path), frame, o.trajectory, o.placing, with_others_as_other(tooth));
  warn_or_refuse(result.notes, o.strict);
  say(common, o.trajectory + ": placed " + result.how);
  return std::move(result.path);
}

void say_figures(const ReplayResult& r, const Trace& trace, const std::optional<double>& touching,
                 const Common& common) {
  const SessionTotals& t = r.totals;
  if (t.rejected_steps > 0)
    say(common, fmt::format("{} steps were not made: the device's readings were rejected there",
                            t.rejected_steps));
  for (const std::string& text : run_warnings(t, *drive_named(trace.drive))) warn(text);
  say(common,
      fmt::format(
          "{} steps, {:.1f} s at {:.0f} times real time; step {:.1f} us median, {:.1f} us 99 %",
          trace.rows.size() - 1, r.seconds_simulated, r.seconds_simulated / r.seconds_computed,
          r.step_us_p50, r.step_us_p99));
  say(common, fmt::format("removed: enamel {:.3f}, dentin {:.3f}, pulp {:.3f}, other {:.3f} mm^3",
                          t.removed[0], t.removed[1], t.removed[2], t.removed[3]));
  for (const std::string& line : body_lines(trace.bodies, t)) say(common, line);
  std::string where;
  if (!touching)
    where = " (the coupling's, in air)";
  else if (*touching < t.peak_device_force)
    where = fmt::format(" (the coupling's, in air; {:.2f} N in contact)", *touching);
  if (trace.drive == "coupled")
    say(common,
        fmt::format("peak force {:.2f} N{}; largest lag of the bur behind the handle {:.2f} "
                    "mm; stalled {} steps in {} stalls",
                    t.peak_device_force, where, t.largest_lag, t.stalled_steps, t.stall_onsets));
  else if (trace.drive == name_of(Drive::kLoad))
    say(common, fmt::format("largest load {:.2f} N; stalled {} steps in {} stalls",
                            t.peak_device_force, t.stalled_steps, t.stall_onsets));
  else
    say(common, fmt::format("peak force {:.2f} N", t.peak_device_force));
}

// The bur left the tooth, which ends a cut, or it never met it, which is a mistake.
void report_run_off(const ReplayResult& r, const Options& o) {
  const Vec3& load = r.rows.back().handle.load;
  if (r.totals.contact_steps == 0)
    throw InputError(o.trajectory, "row 0",
                     fmt::format("a bur that starts there and is pushed by ({:g}, {:g}, {:g}) N "
                                 "goes {:g} mm without touching the tooth",
                                 load.x(), load.y(), load.z(), kMostWayWithoutContact),
                     "start it at the tooth, and push it towards the tooth");
  warn_or_refuse({fmt::format("{}: the bur left the tooth and went {:g} mm without contact; the "
                              "run ends there, at {:.3f} s",
                              o.trajectory, kMostWayWithoutContact, r.rows.back().handle.time)},
                 o.strict);
}

// `path`: with a load its first place, since later ones mean nothing.
void check_near(const Options& o, const std::vector<HandleSample>& path,
                const LayeredTooth& tooth) {
  const double distance = distance_to_tooth(path, bounds_of_solid(tooth));
  if (distance <= kFarFromTooth) return;
  const std::string text =
      o.trajectory +
      fmt::format(": the path never comes within 5 mm of the tooth (nearest {:.1f} mm)", distance);
  if (o.strict) throw Error(text + "; check the frames of both files");
  warn(text);
}

// Both at the same time, each to its end: where one throws, the other's own loops would be cancelled, and what
// they should have filled would be used empty.
template <class First, class Second>
void run_both(const First& first, const Second& second) {
  std::exception_ptr failed[2];
  const auto attempt = [](const auto& work, std::exception_ptr& error) {
    try {
      work();
    } catch (...) {
      error = std::current_exception();
    }
  };
  tbb::parallel_invoke([&] { attempt(first, failed[0]); }, [&] { attempt(second, failed[1]); });
  for (const std::exception_ptr& error : failed)
    if (error) std::rethrow_exception(error);
}

// The same as `mesh` writes of the prepared tooth's file.
void write_mesh_of(const LayeredTooth& prepared, const std::string& path) {
  const TriangleMesh mesh = surface_by_tissue(prepared).mesh;
  if (mesh.triangles.empty())
    throw Error(
        "--mesh: nothing remains of the tooth, so there is no surface; leave the option out to get "
        "the other outputs");
  write_surface(mesh, path);
}

Trajectory read_motion(const Options& o, PathFrame& frame) {
  Trajectory trajectory = read_trajectory(o.trajectory, frame);
  if (trajectory.unfinished) warn_or_refuse({unfinished_text(o.trajectory)}, o.strict);
  if (trajectory.rows_every > 1)
    warn_or_refuse({sparse_text(o.trajectory, trajectory.rows_every)}, o.strict);
  return trajectory;
}

std::vector<Finding> judge_inputs(const Options& o, const Trajectory& trajectory,
                                  const Parameters& parameters) {
  const auto judged = [&](const Trajectory& t) {
    return judge_motion(t.samples, drive_of(o.session));
  };
  std::vector<Finding> findings =
      any_rejected(trajectory) ? judged(without_rejected(trajectory)) : judged(trajectory);
  for (Finding& f : judge_parameters(parameters)) findings.push_back(std::move(f));
  if (o.strict) warn_or_refuse(o.trajectory, findings, true);
  check_run_memory(o.trajectory, trajectory, parameters.time_step);
  return findings;
}

void run(const Options& o, const Common& common) {
  Outputs outputs(o.force);
  outputs.reads({o.session.tooth, o.session.bur, o.session.params, o.trajectory, o.placing.from,
                 o.placing.at, o.placing.registration});
  const std::string output = outputs.file(o.output, {".h5", ".hdf5"});
  const std::string prepared = outputs.optional_file(o.prepared, {".vdb"});
  const std::string mesh = outputs.optional_file(o.mesh, kSurfaceExtensions);
  outputs.begin();

  const Parameters parameters = load_parameters(o.session);
  if (static_cast<double>(o.trace_every) * parameters.time_step > kMostBetweenRows * (1 + 1e-9))
    throw Error(
        fmt::format("--trace-every: {} steps of {:g} s are more than {:g} s, so the trace "
                    "would show no motion any more; at most {:.0f}",
                    o.trace_every, parameters.time_step, kMostBetweenRows,
                    std::floor(kMostBetweenRows / parameters.time_step * (1 + 1e-9))));
  const Bur bur = make_bur(o.session.bur, data_folder() + "/burs");
  const bool loaded = drive_of(o.session) == Drive::kLoad;
  PathFrame frame = PathFrame::kFile;
  Trajectory trajectory;
  std::vector<Finding> findings;
  ToothReading reading;
  run_both(
      [&] {
        trajectory = read_motion(o, frame);
        findings = judge_inputs(o, trajectory, parameters);
      },
      [&] { reading = read_tooth_with_warnings(o.session.tooth); });
  warn_or_refuse(reading.warnings, o.strict);
  LayeredTooth& tooth = reading.tooth;
  if (o.placing.any() || frame == PathFrame::kTooth)
    trajectory = put_on_tooth(std::move(trajectory), frame, tooth, o, common);
  if (loaded) put_load(o.session, o.trajectory, trajectory);
  const std::vector<HandleSample> path =
      resample(trajectory, parameters.time_step, o.allow_gaps, o.trajectory);
  trajectory.samples = std::vector<HandleSample>();  // gives the storage back

  check_near(o, loaded ? std::vector<HandleSample>{path.front()} : path, tooth);

  Trace trace;
  trace.parameters_toml = to_toml(parameters);
  trace.toothprep_version = kVersion;
  trace.bur = o.session.bur;
  trace.drive = o.session.drive;
  trace.engine = name_of(parameters.engine);
  if (tooth.bodies) trace.bodies = tooth.bodies->list;

  const Interventions interventions = interventions_of(trajectory.events, bur, o.trajectory);
  trace.events = trajectory.events;
  std::optional<Workpiece> ready;
  run_both([&] { trace.tooth_sha256 = tooth_sha256(tooth); }, [&] { ready.emplace(tooth); });
  Workpiece& workpiece = *ready;
  const bool terminal = !common.quiet && isatty(2);
  ReplayResult r = replay(bur, workpiece, parameters, drive_of(o.session), path,
                          terminal ? Progress() : std::function<void(double)>(), interventions);
  if (terminal) std::fprintf(stderr, "\r            \r");
  if (r.ran_off) report_run_off(r, o);

  const Audit audit = judge_audit(r.totals.torque_work, r.removed_energy, r.ground, parameters);
  findings = judge_run(std::move(findings), audit, r.totals.peak_device_force, r.totals.largest_lag,
                       drive_of(o.session));
  warn_or_refuse(o.trajectory, findings, o.strict);

  // Before the tooth is what is left of it.
  std::vector<std::string> outcome = outcome_warnings(r.rows, bur, tooth);
  for (std::string& text : body_warnings(r.totals, trace.bodies))
    outcome.push_back(std::move(text));
  warn_or_refuse(outcome, o.strict);

  trace.rows = std::move(r.rows);
  trace.audit = {r.totals.torque_work, r.removed_energy, r.energy_ratio};
  for (const double v : r.totals.initial_overlap) trace.initial_overlap_mm3 += v;
  run_both(
      [&] {
        if (o.trace_every > 1)
          write_trace(every_nth_row(trace, o.trace_every), output);
        else
          write_trace(trace, output);
      },
      [&] {
        if (prepared.empty() && mesh.empty()) return;
        apply_cut(tooth, workpiece);
        if (!prepared.empty()) write_tooth(tooth, prepared);
        if (!mesh.empty()) write_mesh_of(tooth, mesh);
      });
  std::optional<double> element_mm;
  if (parameters.engine == EngineKind::kLevelset) element_mm = element_size(bur, parameters);
  const std::optional<double> touching = peak_force_in_contact(trace.rows);
  const Json report =
      o.json ? report_json(r, trace, o, audit, findings, element_mm, touching, outcome) : Json();
  outputs.publish();

  say_figures(r, trace, touching, common);
  say(common, audit_text(audit));
  if (o.json) std::cout << json_text(report);
}

}  // namespace

void add_replay(CLI::App& app, const Common& common) {
  auto o = std::make_shared<Options>();
  CLI::App* sub = app.add_subcommand(
      "replay", "Runs a trajectory through force, coupling, stall and removal; writes a trace");
  add_session_options(*sub, o->session, true);
  sub->add_option(
      "--trajectory", o->trajectory,
      "Handle's motion: script .toml, .csv, or .h5 (formats in data/trajectories); required");
  add_placing_options(*sub, o->placing, "--place");
  sub->add_option("-o,--output", o->output, "Trace to write (.h5), required");
  sub->add_option("--trace-every", o->trace_every,
                  "Write every Nth step only to the trace (1: all; up to 0.1 s between rows)")
      ->check(CLI::Range(std::size_t{1}, kMostSamples));
  sub->add_option("--prepared", o->prepared, "Also write the prepared tooth (.vdb)");
  sub->add_option("--mesh", o->mesh,
                  "Also write its surface (.ply, .stl, .obj, .vtk, .glb, .3mf), as 'mesh' would");
  sub->add_flag("--allow-gaps", o->allow_gaps, "Interpolate gaps above 0.1 s in the trajectory");
  add_strict(
      *sub, o->strict,
      "a path far from the tooth, a run that removes nothing, opens the pulp or cuts 'other',\n"
      "implausible inputs, an energy audit out of range");
  sub->add_flag("--json", o->json, "Figures of the run as JSON on stdout");
  sub->add_flag("--force", o->force, "Replace existing outputs");
  sub->footer(
      "Example: toothprep replay --tooth tooth.vdb --trajectory "
      "data/trajectories/class1-molar.toml\n"
      "         --bur cylinder:D1.2xL3.0 --prepared prepared.vdb -o trace.h5");
  sub->callback([o, &common] {
    if (o->session.bur == "list") return print_bur_library();
    if (o->session.bur.empty()) throw CLI::RequiredError("--bur");
    if (o->session.tooth.empty()) throw CLI::RequiredError("--tooth");
    if (o->trajectory.empty()) throw CLI::RequiredError("--trajectory");
    if (o->output.empty()) throw CLI::RequiredError("--output");
    const bool loaded = o->session.drive == name_of(Drive::kLoad);
    if (!loaded && !o->session.load.empty())
      throw CLI::ValidationError("--load-n: needs --drive load");
    if (!loaded && !o->session.rail.empty())
      throw CLI::ValidationError("--rail: needs --drive load");
    run(*o, common);
  });
}

}  // namespace toothprep::app
