// Preparations of a tooth (figure 16): scripted paths, one after the other where a preparation
// takes several burs.
#include <algorithm>
#include <cmath>

#include "toothprep/proof/figures/figure_context.h"

namespace toothprep::figures {
namespace {

// The runs that start from an untouched tooth, each followed by those that go on from it.
std::vector<std::vector<std::size_t>> chains_of(const std::vector<Run>& runs) {
  std::vector<std::vector<std::size_t>> chains;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    if (runs[i].after.empty()) {
      chains.push_back({i});
      continue;
    }
    for (auto& chain : chains)
      if (std::any_of(chain.begin(), chain.end(),
                      [&](std::size_t n) { return runs[n].name == runs[i].after; })) {
        chain.push_back(i);
        break;
      }
  }
  return chains;
}

}  // namespace

FigureReport preparation_figure(const Experiment& experiment, FigureContext& context) {
  const FigureOptions& o = context.options();
  FigureReport figure;
  const LayeredTooth whole = context.specimen(experiment, experiment.runs.front(), o.voxel);
  const std::string before =
      figure.surfaces.insert(context.write_layers(experiment, "before", whole)).first->first;
  std::vector<Outcome> outcomes(experiment.runs.size());
  std::vector<FigureContext::Job> jobs;
  for (const std::vector<std::size_t>& chain : chains_of(experiment.runs))
    jobs.push_back(
        {experiment.name,
         [&, chain] {
           for (const std::size_t i : chain) {
             const Run& run = experiment.runs[i];
             const auto start = std::find_if(experiment.runs.begin(), experiment.runs.end(),
                                             [&](const Run& r) { return r.name == run.after; });
             Parameters p = parameters_of(run, o.base);
             p.engine = o.engines.front();
             outcomes[i] = run_on(
                 run, p, context.path(run, p),
                 start == experiment.runs.end()
                     ? whole
                     : outcomes[static_cast<std::size_t>(start - experiment.runs.begin())].prepared,
                 o.bur_library);
           }
         },
         static_cast<int>(chain.size())});
  context.run(jobs);

  for (std::size_t i = 0; i < experiment.runs.size(); ++i) {
    const Run& run = experiment.runs[i];
    Outcome& outcome = outcomes[i];
    const std::string engine = name_of(outcome.parameters.engine);
    RunReport report = report_of(run, outcome, o.voxel, nullptr);
    report.trace = context.write_trace(experiment, run.name, run, outcome);
    const std::string prepared =
        figure.surfaces
            .insert(context.write_layers(experiment, run.name, std::move(outcome.prepared)))
            .first->first;
    for (const char* view : {"occlusal", "oblique"})
      figure.pictures.push_back(
          {experiment.name + "/" + run.name + "-" + view + ".png",
           experiment.title + ": " + run.title + ", before and after, " + view + " view", prepared,
           before, view});
    figure.runs.push_back(report);

    const auto& totals = outcome.replay.totals;
    const auto pulp = static_cast<std::size_t>(tissue_index(Tissue::kPulp));
    const std::string what = run.title;
    figure.claims.push_back(near(what, engine, "work of the torque / energy removed", "1",
                                 "invariant", 1, outcome.replay.energy_ratio, kAuditAim));
    figure.claims.push_back(
        near(what, engine, "pulp removed", "mm³", "dentistry", 0, totals.removed[pulp], 0, 1));
    figure.claims.push_back(near(what, engine, "steps in which the shank touches", "1", "dentistry",
                                 0, static_cast<double>(totals.shank_contact_steps), 0, 1));
    figure.claims.push_back(bound(what, engine, "largest force", "N", "limit of a Phantom Desktop",
                                  7.9, totals.peak_device_force));
    figure.claims.push_back(near(
        what, engine, "lag at the end", "mm", "finishing passes", 0,
        (outcome.replay.rows.back().bur.position - outcome.replay.rows.back().handle.pose.position)
            .norm(),
        2, 1));
  }
  return figure;
}

}  // namespace toothprep::figures
