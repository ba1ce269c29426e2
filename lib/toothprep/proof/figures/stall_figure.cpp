// Stall (figure 14): where the bur stalls, how it stands, and how it starts again.
#include <cmath>

#include "toothprep/proof/figures/figure_context.h"
#include "toothprep/proof/reference/closed_forms.h"
#include "toothprep/step/bur/bur_library.h"

namespace toothprep::figures {
namespace {

// Percent; the voxel engine's contact is one of whole voxels.
double stall_aim(EngineKind engine) { return engine == EngineKind::kLevelset ? 1 : 3; }

struct StallRows {
  std::size_t onset = 0, end = 0;  // first stalled row, first row after
  bool stalled = false, restarts = false;
};
StallRows first_stall(const std::vector<StepRecord>& rows) {
  StallRows s;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (!s.stalled && rows[i].stalled) {
      s.stalled = true;
      s.onset = i;
      s.end = rows.size();
    } else if (s.stalled && !rows[i].stalled) {
      s.restarts = true;
      s.end = i;
      break;
    }
  }
  return s;
}

void claim_stall(FigureReport& figure, const Run& run, const Bur& bur, const Outcome& outcome,
                 const Exact& exact) {
  const std::vector<StepRecord>& rows = outcome.replay.rows;
  const Parameters& p = outcome.parameters;
  const std::string engine = name_of(p.engine);
  const double allowed = stall_aim(p.engine);
  const StallRows s = first_stall(rows);
  const auto& totals = outcome.replay.totals;
  if (!exact.stall) {
    figure.claims.push_back(near("Fed slower, the bur doesn't stall (" + run.name + ")", engine,
                                 "stalls", "1", "equation of motion", 0,
                                 static_cast<double>(totals.stall_onsets), 0, 1));
    return;
  }
  const reference::StallEvent& event = *exact.stall;
  const std::string what = "Stalls where the torque reaches its limit (" + run.name + ")";
  figure.claims.push_back(near(what, engine, "stalls", "1", "equation of motion", 1,
                               static_cast<double>(totals.stall_onsets), 0));
  if (!s.stalled || s.onset == 0) return;
  const StepRecord& before = rows[s.onset - 1];
  if (run.bur.rfind("cylinder:", 0) == 0) {
    const GrindingProperties& t = p.tissue[0];
    const reference::Grinding g{t.specific_energy, t.force_ratio, p.handpiece.rotation_rate};
    figure.claims.push_back(
        near(what, engine, "speed of the bur", "mm/s", "closed form",
             cylinder_stall_speed(g, bur.max_radius(), bur.head_length(), p.handpiece.stall_torque),
             before.bur_velocity.norm(), allowed));
    const reference::SteadyLoad load =
        reference::cylinder_at_stall(t.force_ratio, bur.max_radius(), p.handpiece.stall_torque);
    figure.claims.push_back(near(what, engine, "force |F|", "N", "closed form",
                                 std::hypot(load.against, load.across),
                                 before.grinding_force.norm(), allowed));
  }
  figure.claims.push_back(near(what, engine, "time", "s", "equation of motion", event.time,
                               rows[s.onset].handle.time, allowed));
  // Standing still.
  double moved = 0;
  for (std::size_t i = s.onset; i < s.end; ++i)
    moved = std::max(moved, (rows[i].bur.position - before.bur.position).norm());
  figure.claims.push_back(near("A stalled bur stands still (" + run.name + ")", engine,
                               "way while stalled", "mm", "the paper", 0, moved, 0, 1));
  // The force rises with the handle's speed times the spring's stiffness.
  const double h = p.time_step;
  const auto window = static_cast<std::size_t>(std::lround(0.2 / h));
  if (s.end > s.onset + window) {
    const StepRecord &a = rows[s.onset], &b = rows[s.onset + window];
    const Vec3 handle = b.handle.pose.position - a.handle.pose.position;
    if (handle.norm() > 0.05)
      figure.claims.push_back(near("The coupling force rises with the handle (" + run.name + ")",
                                   engine, "slope in the 0.2 s after", "N/s", "k v_handle",
                                   p.coupling.stiffness * handle.norm() / 0.2,
                                   (b.grinding_force - a.grinding_force).norm() / 0.2, allowed));
  }
  if (!s.restarts) return;
  const std::string again = "Pulled back, it starts again (" + run.name + ")";
  figure.claims.push_back(bound(again, engine, "torque at the restart", "mN·m", "Eq. 11",
                                p.handpiece.stall_torque, rows[s.end].torque));
  figure.claims.push_back(near(again, engine, "|F| at the restart", "N", "|F| at the stall",
                               before.grinding_force.norm(), rows[s.end].grinding_force.norm(),
                               allowed));
  double removed = 0;
  for (int k = 0; k < kTissueCount; ++k)
    removed += rows.back().removed_volume[k] - rows[s.end].removed_volume[k];
  figure.claims.push_back(
      bound(again, engine, "volume removed afterwards", "mm³", "the paper", 0.1, removed, true));
}

}  // namespace

FigureReport stall_figure(const Experiment& experiment, FigureContext& context) {
  const FigureOptions& o = context.options();
  FigureReport figure;
  struct Variant {
    const Run* run;
    Parameters parameters;
    std::vector<HandleSample> path;
    Outcome outcome;
    Exact exact;
  };
  std::vector<Variant> variants;
  for (const Run& run : experiment.runs)
    for (const EngineKind engine : o.engines) {
      Parameters p = parameters_of(run, o.base);
      p.engine = engine;
      variants.push_back({&run, p, context.path(run, p), {}, {}});
    }
  std::vector<ExactTask> tasks;
  for (const Variant& v : variants) tasks.push_back({*v.run, v.parameters, v.path});
  std::vector<Exact> exact = exact_answers(tasks, o.bur_library);
  for (std::size_t i = 0; i < variants.size(); ++i) variants[i].exact = std::move(exact[i]);
  std::vector<FigureContext::Job> jobs;
  for (Variant& v : variants)
    jobs.push_back({experiment.name, [&] {
                      v.outcome =
                          run_on(*v.run, v.parameters, v.path,
                                 context.specimen(experiment, *v.run, o.voxel), o.bur_library);
                      // The exact answer doesn't start again.
                      const StallRows s = first_stall(v.outcome.replay.rows);
                      if (!s.restarts) return;
                      v.exact.force.resize(s.end);
                      v.exact.torque.resize(s.end);
                      v.exact.area.resize(s.end);
                    }});
  context.run(jobs);

  for (const Run& run : experiment.runs) {
    Plot plot;
    plot.file = experiment.name + "/" + run.name;
    plot.title = experiment.title + ": " + run.title;
    std::vector<Curve> curves;
    std::string exact_file;
    for (Variant& v : variants) {
      if (v.run != &run) continue;
      const bool levelset = v.parameters.engine == EngineKind::kLevelset;
      const std::string name = run.name + "-" + name_of(v.parameters.engine);
      RunReport report = report_of(run, v.outcome, o.voxel, &v.exact);
      report.trace = context.write_trace(experiment, name, run, v.outcome);
      if (exact_file.empty())
        exact_file = context.write_exact(experiment, run.name + "-exact", v.path, v.exact);
      report.exact = exact_file;
      curves.insert(curves.begin(), {levelset ? "level sets" : "voxels", report.trace, "",
                                     levelset ? "run" : "second"});
      plot.stalled = plot.stalled.empty() ? report.trace : plot.stalled;
      figure.runs.push_back(report);
      claim_stall(figure, run, make_bur(run.bur, o.bur_library), v.outcome, v.exact);
      if (run.name == experiment.runs.front().name && v.parameters.engine == o.engines.front()) {
        auto [mesh, surface] = context.write_surface(experiment, name, v.outcome.prepared);
        figure.pictures.push_back(block_picture(experiment.name + "/" + name + ".png",
                                                experiment.title + ": the block, " + run.title,
                                                mesh));
        figure.surfaces.emplace(std::move(mesh), std::move(surface));
      }
    }
    plot.panels = force_panels(curves, exact_file);
    Panel y = {"$y$ (mm)", {}};
    y.curves.push_back({"handle", curves.back().file, "handle_y_mm", "thin"});
    y.curves.push_back({"bur", curves.back().file, "bur_y_mm", "run"});
    plot.panels.push_back(y);
    plot.tissues = exact_file;
    figure.plots.push_back(plot);
  }
  return figure;
}

}  // namespace toothprep::figures
