#include "toothprep/proof/figures/figures.h"

#include <tbb/parallel_for.h>

#include <cmath>

#include "toothprep/proof/figures/figure_context.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"

namespace toothprep::figures {
namespace {

FigureReport run_experiment(const Experiment& experiment, FigureContext& context) {
  switch (experiment.kind) {
    case Kind::kPlateaus:
    case Kind::kProportionalToSpeed:
    case Kind::kProportionalToArea:
      return feed_figure(experiment, context);
    case Kind::kStall:
      return stall_figure(experiment, context);
    case Kind::kClosedLoop:
      return closed_loop_figure(experiment, context);
    case Kind::kPreparations:
      return preparation_figure(experiment, context);
    case Kind::kLiteral:
      return literal_figure(experiment, context);
    case Kind::kDroop:
      return droop_figure(experiment, context);
    case Kind::kPasses:
      return passes_figure(experiment, context);
    case Kind::kAblations:
      return ablation_figure(experiment, context);
    case Kind::kFeasibility:
      return feasibility_figure(experiment, context);
    case Kind::kLaws:
      return laws_figure(experiment, context);
    case Kind::kRotor:
      return rotor_figure(experiment, context);
    case Kind::kValidation:
      return validation_figure(experiment, context);
    case Kind::kTransparency:
      return transparency_figure(experiment, context);
  }
  return {};
}

// What can be known to be wrong before anything runs.
void check(const Experiment& experiment, FigureContext& context) {
  const FigureOptions& options = context.options();
  const bool exact = experiment.kind == Kind::kPlateaus || experiment.kind == Kind::kStall ||
                     experiment.kind == Kind::kProportionalToSpeed ||
                     experiment.kind == Kind::kProportionalToArea ||
                     experiment.kind == Kind::kFeasibility || experiment.kind == Kind::kPasses ||
                     experiment.kind == Kind::kAblations || experiment.kind == Kind::kLaws ||
                     experiment.kind == Kind::kTransparency;
  for (const Run& run : experiment.runs) {
    const Parameters p = parameters_of(run, options.base, !run.literal.empty());
    if (!run.trajectory.empty()) context.keep_path(run, p);
    static_cast<void>(make_bur(run.bur, options.bur_library));
    if (experiment.kind != Kind::kValidation && experiment.kind != Kind::kLaws && !is_linear(p))
      throw Error(experiment.name +
                  ": what it is held against knows the paper's law only; leave size_exponent, "
                  "ratio_exponent, rubbing_pressure_n_per_mm2 and up_cutting out of --params, or "
                  "choose --only validation,laws");
    if (experiment.kind != Kind::kValidation && experiment.kind != Kind::kRotor &&
        p.handpiece.rotor_inertia > 0)
      throw Error(experiment.name +
                  ": what it is held against knows no rotor with inertia; leave [handpiece] "
                  "rotor_inertia_g_mm2 out of --params, or choose --only validation");
    if (experiment.kind == Kind::kDroop && p.handpiece.droop_exponent != 1)
      throw Error(experiment.name +
                  ": its exact answer knows the linear droop only; leave [handpiece] "
                  "droop_exponent out of --params, or leave it out with --only");
    if (exact && p.handpiece.model == HandpieceModel::kDroop &&
        std::isfinite(p.handpiece.stall_torque))
      throw Error(experiment.name +
                  ": its exact answer knows a fixed rotation rate only; give [handpiece] model = "
                  "\"fixed\" in --params, or leave it out with --only");
  }
}

const RunReport* find_run(const std::vector<FigureReport>& figures, const std::string& name,
                          const std::string& engine, double voxel) {
  for (const FigureReport& f : figures)
    if (f.name == name)
      for (const RunReport& r : f.runs)
        if (r.engine == engine && r.voxel_mm == voxel && r.has_plateau) return &r;
  return nullptr;
}

// What the coupling does to the voxel effect: figure 13 beside figure 9.
void compare_coupled_with_direct(std::vector<FigureReport>& figures, double voxel) {
  for (const char* engine : {"levelset", "voxel"}) {
    const RunReport* direct = find_run(figures, "figure-09", engine, voxel);
    const RunReport* coupled = find_run(figures, "figure-13", engine, voxel);
    if (!direct || !coupled) continue;
    for (FigureReport& f : figures) {
      if (f.name != "figure-13") continue;
      const std::string claim = "The coupling takes the voxel effect away";
      // The voxel engine's plateaus are flat but for rounding: its effect is steps where it enters
      // and crosses.
      if (direct->voxel_effect_above_2_hz_percent > 1e-3)
        f.claims.push_back(bound(claim, engine,
                                 "ripple on the plateaus above 2 Hz, of that in direct drive", "%",
                                 "the paper; a tenth is ours", 10,
                                 100 * coupled->voxel_effect_above_2_hz_percent /
                                     direct->voxel_effect_above_2_hz_percent));
      f.claims.push_back(bound(claim, engine,
                               "largest deviation on the way, of that in direct drive", "%",
                               "the paper; half is ours", 50,
                               100 * coupled->force_max_percent / direct->force_max_percent));
    }
  }
}

}  // namespace

std::vector<FigureReport> run_figures(const FigureOptions& options) {
  std::vector<Experiment> experiments;
  int replays = 0;
  for (const std::string& folder : options.experiments) {
    experiments.push_back(read_experiment(folder));
    replays += replays_of(experiments.back(), options);
  }
  FigureContext context(options, replays);
  for (const Experiment& experiment : experiments) check(experiment, context);
  // At once: where one's last replay runs alone, others fill the cores.
  std::vector<FigureReport> figures(experiments.size());
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, experiments.size(), 1),
      [&](const tbb::blocked_range<std::size_t>& range) {
        for (std::size_t i = range.begin(); i < range.end(); ++i) {
          figures[i] = run_experiment(experiments[i], context);
          figures[i].name = experiments[i].name;
          figures[i].title = experiments[i].title;
        }
      },
      tbb::simple_partitioner());
  compare_coupled_with_direct(figures, options.voxel);
  std::string engines;
  for (const EngineKind engine : options.engines)
    engines += (engines.empty() ? "" : ", ") + std::string(name_of(engine));
  write_report({options.version, options.build, to_toml(options.base), options.voxel, engines},
               figures, options.output);
  return figures;
}

}  // namespace toothprep::figures
