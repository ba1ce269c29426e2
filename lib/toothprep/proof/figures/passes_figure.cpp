// Overlapping passes, as every real cavity is cut: the work and the force of each against what it
// newly sweeps.
#include <algorithm>
#include <cmath>

#include "toothprep/proof/figures/figure_context.h"
#include "toothprep/proof/reference/swept_passes.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/grinding/engine.h"

namespace toothprep::figures {
namespace {

// What is allowed of a pass at the voxel size of the run, and at half of it with elements of half the
// size, percent: of its own
// energy or of the first pass's, whichever is more. A chip can be as thin as a voxel's wall error.
constexpr double kOfPass[2] = {1, 0.3}, kOfFirst[2] = {0.2, 0.05};
constexpr double kForceOfPass = 1, kForceOfFirst = 0.2;

struct Pass {
  std::size_t first, last;  // samples: moves from the first to the last
};

// The stretches of a path that lead along x with the motor on.
std::vector<Pass> passes_of(const std::vector<HandleSample>& path) {
  std::vector<Pass> passes;
  for (std::size_t i = 1; i < path.size(); ++i) {
    const Vec3 way = path[i].pose.position - path[i - 1].pose.position;
    if (!(path[i].buttons & kPedalButton) || std::abs(way.x()) < 1e-9 ||
        std::hypot(way.y(), way.z()) > 1e-9)
      continue;
    if (!passes.empty() && passes.back().last == i - 1)
      passes.back().last = i;
    else
      passes.push_back({i - 1, i});
  }
  return passes;
}

// The exact answers hold for passes right through the block, at one orientation.
void check(const Experiment& experiment, const Run& run, const Bur& bur,
           const std::vector<HandleSample>& path, const std::vector<Pass>& passes) {
  const double clear = run.block.size.x() / 2 + std::hypot(bur.head_length(), bur.max_radius());
  if (passes.empty()) throw Error(experiment.name + ": its path never leads along x");
  for (const Pass& pass : passes)
    for (const std::size_t end : {pass.first, pass.last})
      if (std::abs(path[end].pose.position.x()) < clear)
        throw Error(experiment.name + ": a pass must start and end at least " +
                    std::to_string(clear) + " mm from the block's middle, clear of it");
  for (const HandleSample& s : path)
    if (!s.pose.orientation.isApprox(path.front().pose.orientation, 1e-9))
      throw Error(experiment.name + ": its path must not turn the bur");
}

// What of a run doesn't depend on voxels and elements.
struct ExactPasses {
  std::vector<HandleSample> path;
  std::vector<Pass> passes;
  std::vector<double> energy;  // mJ, of what each newly sweeps
  std::vector<Vec3> force;     // N, in the block's middle
};

ExactPasses exact_passes(const Experiment& experiment, const Run& run, FigureContext& context) {
  const FigureOptions& o = context.options();
  const Parameters p = parameters_of(run, o.base);
  const Bur bur = make_bur(run.bur, o.bur_library);
  ExactPasses exact;
  exact.path = context.path(run, p);
  exact.passes = passes_of(exact.path);
  check(experiment, run, bur, exact.path, exact.passes);
  const Quat orientation = exact.path.front().pose.orientation;
  const reference::Block block{run.block.size, run.block.enamel};
  std::vector<Vec3> tips;
  std::vector<double> speeds;
  for (const Pass& pass : exact.passes) {
    tips.push_back(exact.path[pass.first].pose.position);
    const std::size_t middle = (pass.first + pass.last) / 2;
    speeds.push_back(
        (exact.path[middle].pose.position.x() - exact.path[middle - 1].pose.position.x()) /
        p.time_step);
  }
  for (const PerTissue<double>& section :
       reference::newly_swept_sections(bur, orientation, tips, block))
    exact.energy.push_back(block.size.x() * (p.tissue[0].specific_energy * section[0] +
                                             p.tissue[1].specific_energy * section[1]));
  for (const reference::Load& load : reference::loads_in_swept(reference::make_scene(bur, block, p),
                                                               bur, orientation, tips, speeds))
    exact.force.push_back(load.force);
  return exact;
}

void claim_passes(FigureReport& figure, const Run& run, const ExactPasses& exact,
                  const Outcome& outcome, double voxel, int fineness) {
  const Parameters& p = outcome.parameters;
  const std::vector<StepRecord>& rows = outcome.replay.rows;
  double first_force = 0;
  for (std::size_t k = 0; k < exact.passes.size(); ++k) {
    const std::string what = run.title + ", pass " + std::to_string(k + 1) + ", voxels of " +
                             std::to_string(voxel).substr(0, 5) + " mm";
    double work = 0, square = 0;
    std::size_t level = 0;
    const Vec3& force = exact.force[k];
    for (std::size_t i = exact.passes[k].first + 1; i <= exact.passes[k].last; ++i) {
      work += rows[i].power * p.time_step;
      if (std::abs(exact.path[i].pose.position.x()) > run.block.size.x() / 8) continue;
      square += (rows[i].grinding_force - force).squaredNorm();
      ++level;
    }
    const double energy = exact.energy[k];
    first_force = std::max(first_force, force.norm());
    figure.claims.push_back(near(
        what, name_of(p.engine), "work of the torque", "mJ", "exact: u times what it newly sweeps",
        energy, work, std::max(kOfPass[fineness], kOfFirst[fineness] * exact.energy[0] / energy)));
    const double rms = std::sqrt(square / static_cast<double>(std::max<std::size_t>(level, 1)));
    figure.claims.push_back(
        bound(what, name_of(p.engine), "RMS error of the force in the middle", "%",
              "exact integral over the engaged surface",
              std::max(kForceOfPass, kForceOfFirst * first_force / force.norm()),
              100 * rms / force.norm()));
  }
}

}  // namespace

FigureReport passes_figure(const Experiment& experiment, FigureContext& context) {
  const FigureOptions& o = context.options();
  FigureReport figure;
  std::vector<ExactPasses> exact;
  exact.reserve(experiment.runs.size());
  for (const Run& run : experiment.runs) exact.push_back(exact_passes(experiment, run, context));
  std::vector<Outcome> outcomes(2 * experiment.runs.size());
  std::vector<FigureContext::Job> jobs;
  for (std::size_t i = 0; i < outcomes.size(); ++i)
    jobs.push_back({experiment.name, [&, i] {
                      const Run& run = experiment.runs[i / 2];
                      Parameters p = parameters_of(run, o.base);
                      p.engine = EngineKind::kLevelset;
                      if (i % 2)  // voxels and elements together
                        p.element_size = element_size(make_bur(run.bur, o.bur_library), p) / 2;
                      outcomes[i] =
                          run_on(run, p, exact[i / 2].path,
                                 context.specimen(experiment, run, i % 2 ? o.voxel / 2 : o.voxel),
                                 o.bur_library);
                    }});
  context.run(jobs);
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    const Run& run = experiment.runs[i / 2];
    const double voxel = i % 2 ? o.voxel / 2 : o.voxel;
    RunReport report = report_of(run, outcomes[i], voxel, nullptr);
    report.run = run.name + (i % 2 ? "-fine" : "");
    report.trace = context.write_trace(experiment, report.run, run, outcomes[i]);
    claim_passes(figure, run, exact[i / 2], outcomes[i], voxel, static_cast<int>(i % 2));
    if (i % 2 == 0) {
      Plot plot;
      plot.file = experiment.name + "/" + run.name;
      plot.title = run.title;
      plot.panels = force_panels({{"", report.trace, "", "run"}}, "");
      figure.plots.push_back(plot);
    }
    figure.runs.push_back(report);
  }
  return figure;
}

}  // namespace toothprep::figures
