#include "toothprep/proof/figures/figure_context.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <filesystem>

#include "toothprep/proof/figures/cutting_test.h"
#include "toothprep/step/session/plausibility.h"
#include "toothprep/tools/files/tooth_file.h"
#include "toothprep/tools/files/trace.h"
#include "toothprep/tools/io/csv_writer.h"
#include "toothprep/tools/mesh/tissue_division.h"

namespace toothprep::figures {

namespace fs = std::filesystem;

void FigureContext::run(const std::vector<Job>& jobs) {
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, jobs.size(), 1),
      [&](const tbb::blocked_range<std::size_t>& range) {
        for (std::size_t i = range.begin(); i < range.end(); ++i) {
          jobs[i].work();
          const std::lock_guard lock(mutex_);
          done_ += jobs[i].replays;
          if (options_.progress) options_.progress(done_, replays_, jobs[i].what);
        }
      },
      tbb::simple_partitioner());
}

LayeredTooth FigureContext::specimen(const Experiment& experiment, const Run& run, double voxel) {
  const BlockOptions& b = run.block;
  std::array<double, 6> key = {1, 0, 0, 0, 0, voxel};
  if (!experiment.molar) key = {0, b.size.x(), b.size.y(), b.size.z(), b.enamel, voxel};
  {
    const std::lock_guard lock(mutex_);
    const auto known = specimens_.find(key);
    if (known != specimens_.end()) return known->second;
  }
  // Not under the lock: who makes it in parallel may take up a job that asks for one meanwhile.
  LayeredTooth made = make_specimen(experiment, run, voxel);
  made.tissue.freeze();
  made.solid.freeze();
  const std::lock_guard lock(mutex_);
  return specimens_.try_emplace(key, std::move(made)).first->second;
}

void FigureContext::keep_path(const Run& run, const Parameters& parameters) {
  std::vector<HandleSample>& kept = paths_[{run.trajectory, parameters.time_step}];
  if (kept.empty()) kept = path_of(run, parameters);
}

std::vector<HandleSample> FigureContext::path(const Run& run, const Parameters& parameters) {
  {
    const std::lock_guard lock(mutex_);
    const auto kept = paths_.extract({run.trajectory, parameters.time_step});
    if (kept) return std::move(kept.mapped());
  }
  return path_of(run, parameters);
}

std::string FigureContext::place(const Experiment& experiment, const std::string& file) const {
  const fs::path folder = fs::path(options_.output) / experiment.name;
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw Error(folder.string() + ": cannot be made: " + error.message());
  return experiment.name + "/" + file;
}

std::string FigureContext::write_trace(const Experiment& experiment, const std::string& name,
                                       const Run& run, Outcome& outcome) const {
  Trace trace;
  trace.parameters_toml = to_toml(outcome.parameters);
  trace.tooth_sha256 = outcome.tooth_sha256;
  trace.toothprep_version = options_.version;
  trace.bur = run.bur;
  trace.drive = name_of(run.drive);
  trace.engine = name_of(outcome.parameters.engine);
  trace.audit = {outcome.replay.totals.torque_work, outcome.replay.removed_energy,
                 outcome.replay.energy_ratio};
  for (const double v : outcome.replay.totals.initial_overlap) trace.initial_overlap_mm3 += v;
  std::string file = place(experiment, name + ".h5");
  trace.rows.swap(outcome.replay.rows);
  toothprep::write_trace(trace, options_.output + "/" + file);
  trace.rows.swap(outcome.replay.rows);
  return file;
}

std::string FigureContext::write_series(const Experiment& experiment, const std::string& name,
                                        const std::vector<std::string>& columns,
                                        const std::vector<std::vector<double>>& values) const {
  std::string file = place(experiment, name + ".csv");
  CsvWriter out(options_.output + "/" + file);
  for (const std::string& column : columns) out.text(column);
  out.end_row();
  for (std::size_t i = 0; i < values.front().size(); ++i) {
    for (const std::vector<double>& column : values) out.number(column[i]);
    out.end_row();
  }
  out.close();
  return file;
}

std::string FigureContext::write_exact(const Experiment& experiment, const std::string& name,
                                       const std::vector<HandleSample>& path,
                                       const Exact& exact) const {
  std::vector<std::vector<double>> values(7);
  for (std::size_t i = 0; i < exact.force.size(); ++i) {
    values[0].push_back(path[i].time);
    for (int a = 0; a < 3; ++a) values[1 + a].push_back(exact.force[i][a]);
    values[4].push_back(exact.torque[i]);
    values[5].push_back(exact.area[i][0]);
    values[6].push_back(exact.area[i][1]);
  }
  return write_series(experiment, name,
                      {"time_s", "force_grinding_x_N", "force_grinding_y_N", "force_grinding_z_N",
                       "torque_mNm", "contact_enamel_mm2", "contact_dentin_mm2"},
                      values);
}

std::pair<std::string, Surface> FigureContext::write_surface(const Experiment& experiment,
                                                             const std::string& name,
                                                             const LayeredTooth& tooth) const {
  std::string file = place(experiment, name + ".ply");
  TriangleMesh mesh = surface_by_tissue(tooth).mesh;
  write_mesh(mesh, options_.output + "/" + file);
  return {std::move(file), Surface{std::move(mesh), {}}};
}

std::pair<std::string, Surface> FigureContext::write_layers(const Experiment& experiment,
                                                            const std::string& name,
                                                            LayeredTooth tooth) const {
  Surface surface = write_surface(experiment, name, tooth).second;
  std::string file = place(experiment, name + ".vdb");
  write_tooth(tooth, options_.output + "/" + file);
  surface.tooth = std::move(tooth);
  return {std::move(file), std::move(surface)};
}

std::vector<Outcome> replay_runs(const Experiment& experiment, EngineKind engine,
                                 FigureContext& context) {
  const FigureOptions& o = context.options();
  std::vector<Outcome> outcomes(experiment.runs.size());
  std::vector<FigureContext::Job> jobs;
  for (std::size_t i = 0; i < experiment.runs.size(); ++i)
    jobs.push_back({experiment.name, [&, i] {
                      const Run& run = experiment.runs[i];
                      Parameters p = parameters_of(run, o.base);
                      p.engine = engine;
                      outcomes[i] =
                          run_on(run, p, context.path(run, p),
                                 context.specimen(experiment, run, o.voxel), o.bur_library);
                    }});
  context.run(jobs);
  return outcomes;
}

RunReport report_of(const Run& run, const Outcome& outcome, double voxel, const Exact* exact) {
  const ReplayResult& r = outcome.replay;
  RunReport report;
  report.run = run.name;
  report.engine = name_of(outcome.parameters.engine);
  report.drive = name_of(run.drive);
  report.voxel_mm = voxel;
  report.energy_ratio = r.energy_ratio;
  const Audit audit =
      judge_audit(r.totals.torque_work, r.removed_energy, r.totals.removed, outcome.parameters);
  report.energy_audit = name_of(audit.verdict);
  for (const Finding& f : judge_run(judge_parameters(outcome.parameters), audit,
                                    r.totals.peak_device_force, r.totals.largest_lag, run.drive))
    report.findings.push_back(message_of(f));
  report.peak_force_n = r.totals.peak_device_force;
  report.largest_lag_mm = r.totals.largest_lag;
  report.stalled_steps = r.totals.stalled_steps;
  report.stall_onsets = r.totals.stall_onsets;
  report.shank_contact_steps = r.totals.shank_contact_steps;
  report.seconds_simulated = r.seconds_simulated;
  report.removed_mm3.assign(r.totals.removed.begin(), r.totals.removed.end());
  if (!exact) return report;
  const Deviation d = deviation(outcome, *exact);
  report.compared = true;
  report.force_rms_percent = d.force_rms;
  report.force_max_percent = d.force_max;
  report.torque_rms_percent = d.torque_rms;
  report.torque_max_percent = d.torque_max;
  for (const Stretch& stretch : plateaus(*exact)) {
    const VoxelEffect effect = voxel_effect(outcome, *exact, stretch);
    report.has_plateau = true;
    report.voxel_effect_percent = std::max(report.voxel_effect_percent, effect.whole);
    if (std::isfinite(effect.above_2_hz))
      report.voxel_effect_above_2_hz_percent =
          std::max(report.voxel_effect_above_2_hz_percent, effect.above_2_hz);
  }
  return report;
}

std::vector<Panel> force_panels(const std::vector<Curve>& files, const std::string& exact) {
  std::vector<Panel> panels = {{"$F_x$ (N)", {}}, {"$F_y$ (N)", {}}, {"$T_z$ (mN·m)", {}}};
  const char* columns[3] = {"force_grinding_x_N", "force_grinding_y_N", "torque_mNm"};
  for (int p = 0; p < 3; ++p) {
    for (Curve curve : files) {
      curve.column = columns[p];
      panels[p].curves.push_back(curve);
    }
    if (!exact.empty()) panels[p].curves.push_back({"exact", exact, columns[p], "exact"});
  }
  return panels;
}

int replays_of(const Experiment& experiment, const FigureOptions& options) {
  const auto engines = static_cast<int>(options.engines.size());
  const auto runs = static_cast<int>(experiment.runs.size());
  switch (experiment.kind) {
    case Kind::kPlateaus:
    case Kind::kProportionalToSpeed:
    case Kind::kProportionalToArea:
      return 3 * engines * runs;
    case Kind::kStall:
      return engines * runs;
    case Kind::kLiteral:
    case Kind::kAblations:
    case Kind::kPasses:
      return 2 * runs;
    case Kind::kClosedLoop:
      return 3;
    case Kind::kFeasibility:
    case Kind::kPreparations:
    case Kind::kDroop:
    case Kind::kLaws:
    case Kind::kRotor:
      return runs;
    case Kind::kTransparency:
      return static_cast<int>(experiment.transparency.devices.size()) + 2;
    case Kind::kValidation:
      return static_cast<int>(read_cutting_tests(experiment.measurements).size());
  }
  return runs;
}

}  // namespace toothprep::figures
