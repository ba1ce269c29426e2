// Places where this implementation departs from the paper's wording, run both ways.
#include <algorithm>
#include <array>
#include <cmath>

#include "toothprep/proof/figures/figure_context.h"

namespace toothprep::figures {
namespace {

// Steps stalled, of those from the first stall on, in percent.
double stalled_share(const std::vector<StepRecord>& rows) {
  std::size_t first = rows.size(), stalled = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].stalled) first = std::min(first, i);
    stalled += rows[i].stalled;
  }
  return first == rows.size()
             ? 0
             : 100 * static_cast<double>(stalled) / static_cast<double>(rows.size() - first);
}

// The way of the bur from its first stall on, mm.
double creep(const std::vector<StepRecord>& rows) {
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (rows[i].stalled) return (rows.back().bur.position - rows[i].bur.position).norm();
  return 0;
}

// The largest way of the bur in one step, mm.
double largest_jump(const std::vector<StepRecord>& rows) {
  double most = 0;
  for (std::size_t i = 1; i < rows.size(); ++i)
    most = std::max(most, (rows[i].bur.position - rows[i - 1].bur.position).norm());
  return most;
}

double time_of_largest_jump(const std::vector<StepRecord>& rows) {
  double most = 0, time = 0;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    const double way = (rows[i].bur.position - rows[i - 1].bur.position).norm();
    if (way <= most) continue;
    most = way;
    time = rows[i].handle.time;
  }
  return time;
}

void claim_consequences(FigureReport& figure, const Run& run, const Outcome& ours,
                        const Outcome& literal) {
  const Parameters& p = literal.parameters;
  const std::string engine = name_of(p.engine);
  const std::vector<StepRecord>&a = ours.replay.rows, &b = literal.replay.rows;
  const std::string here = run.title + ": here", there = run.title + ": literally";
  if (p.handpiece.stall_rule == StallRule::kLastStep) {
    figure.claims.push_back(near(here, engine, "steps stalled from the onset on", "%",
                                 "a stalled bur stands still", 100, stalled_share(a), 0));
    figure.claims.push_back(near(there, engine, "steps stalled from the onset on", "%",
                                 "v = 0 frees it every second step", 50, stalled_share(b), 1));
    figure.claims.push_back(
        bound(there, engine, "way after the onset", "mm", "it creeps on", 0.1, creep(b), true));
    figure.claims.push_back(near(here, engine, "way after the onset", "mm",
                                 "a stalled bur stands still", 0, creep(a), 0, 1));
  }
  if (p.coupling.attached_without_contact) {
    figure.claims.push_back(bound(there, engine, "largest way of the bur in a step", "mm",
                                  "it jumps by the spring's stretch", 0.5, largest_jump(b), true));
    figure.claims.push_back(bound(here, engine, "largest way of the bur in a step", "mm",
                                  "spring and mass", largest_jump(b), largest_jump(a)));
  }
  if (p.trailing_elements) {
    // At the end, where both are steady.
    figure.claims.push_back(
        bound(there, engine, "force over that without", "1", "the rear half holds it back", 1.05,
              b.back().grinding_force.norm() / a.back().grinding_force.norm(), true));
    figure.claims.push_back(bound(there, engine, "torque over that without", "1",
                                  "the rear half takes torque off", 0.95,
                                  b.back().torque / a.back().torque));
  }
}

}  // namespace

FigureReport literal_figure(const Experiment& experiment, FigureContext& context) {
  const FigureOptions& o = context.options();
  FigureReport figure;
  std::vector<std::array<Outcome, 2>> outcomes(experiment.runs.size());
  std::vector<FigureContext::Job> jobs;
  for (std::size_t i = 0; i < experiment.runs.size(); ++i)
    for (const bool literal : {false, true})
      jobs.push_back({experiment.name, [&, i, literal] {
                        const Run& run = experiment.runs[i];
                        const Parameters p = parameters_of(run, o.base, literal);
                        outcomes[i][literal] =
                            run_on(run, p, context.path(run, p),
                                   context.specimen(experiment, run, o.voxel), o.bur_library);
                      }});
  context.run(jobs);

  for (std::size_t i = 0; i < experiment.runs.size(); ++i) {
    const Run& run = experiment.runs[i];
    Plot plot;
    plot.file = experiment.name + "/" + run.name;
    plot.title = run.title;
    plot.panels = {{"device $F_x$ (N)", {}},
                   {"device $F_y$ (N)", {}},
                   {"$T_z$ (mN·m)", {}},
                   {"bur's $y$ (mm)", {}}};
    const char* columns[4] = {"force_device_x_N", "force_device_y_N", "torque_mNm", "bur_y_mm"};
    for (const bool literal : {true, false}) {
      RunReport report = report_of(run, outcomes[i][literal], o.voxel, nullptr);
      const std::string name = run.name + (literal ? "-literal" : "-here");
      report.run = name;
      report.trace = context.write_trace(experiment, name, run, outcomes[i][literal]);
      figure.runs.push_back(report);
      for (int p = 0; p < 4; ++p)
        plot.panels[p].curves.push_back(
            {literal ? "literally" : "here", report.trace, columns[p], literal ? "second" : "run"});
    }
    // A jump is over in a moment: look closely.
    if (outcomes[i][true].parameters.coupling.attached_without_contact) {
      const double moment = time_of_largest_jump(outcomes[i][true].replay.rows);
      plot.from_s = moment - 0.15;
      plot.to_s = moment + 0.35;
    }
    figure.plots.push_back(plot);
    claim_consequences(figure, run, outcomes[i][false], outcomes[i][true]);
  }
  return figure;
}

}  // namespace toothprep::figures
