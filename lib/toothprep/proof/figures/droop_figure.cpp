// A handpiece that droops under load: both of its collapses against their closed forms.
#include <algorithm>
#include <cmath>

#include "toothprep/proof/figures/figure_context.h"
#include "toothprep/proof/reference/closed_forms.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep::figures {
namespace {

constexpr double kAim = 1;  // percent

// Imposed feed: the operating point of every row from the exact power that its feed takes.
void claim_imposed_feed(FigureReport& figure, const Outcome& outcome, const Exact& at_idle_rate,
                        Exact& drooped) {
  const Handpiece& hp = outcome.parameters.handpiece;
  const std::vector<StepRecord>& rows = outcome.replay.rows;
  const std::string engine = name_of(outcome.parameters.engine);
  const std::string what = "Imposed feed";
  double worst_torque = 0, worst_rate = 0;
  std::size_t collapse = rows.size(), exact_collapse = rows.size();
  drooped = at_idle_rate;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    const double power = 2 * units::kPi * hp.rotation_rate * at_idle_rate.torque[i];
    const auto point = reference::droop_imposed_feed(hp.rotation_rate, hp.stall_torque, power);
    if (rows[i].stalled) collapse = std::min(collapse, i);
    if (!point) {
      exact_collapse = std::min(exact_collapse, i);
      drooped.torque[i] = hp.stall_torque;
      continue;
    }
    drooped.torque[i] = point->torque;
    drooped.force[i] *= hp.rotation_rate / point->rotation_rate;
    // Near the collapse the closed form's slope is infinite: a per mille of power is 3 % of torque.
    if (power < 0.98 * reference::droop_greatest_power(hp.rotation_rate, hp.stall_torque) &&
        at_idle_rate.torque[i] > 0) {
      worst_torque = std::max(worst_torque, std::abs(rows[i].torque - point->torque));
      worst_rate = std::max(worst_rate, std::abs(rows[i].rotation_rate - point->rotation_rate));
    }
  }
  figure.claims.push_back(
      bound(what, engine,
            "torque's largest deviation up to 98 % of the greatest power, of the stall torque", "%",
            "closed form", kAim, 100 * worst_torque / hp.stall_torque));
  figure.claims.push_back(bound(what, engine, "rotation rate's largest deviation, of the free one",
                                "%", "closed form", kAim, 100 * worst_rate / hp.rotation_rate));
  if (collapse == rows.size() || exact_collapse == rows.size())
    throw Error("handpiece: the imposed feed never reaches the collapse; feed faster");
  const StepRecord& last = rows[collapse - 1];
  figure.claims.push_back(near(what + " collapses", engine, "feed speed", "mm/s", "closed form",
                               rows[exact_collapse].bur_velocity.norm(), last.bur_velocity.norm(),
                               kAim));
  // Half the stall torque, approached with a vertical slope: judged with that in mind.
  figure.claims.push_back(near(what + " collapses", engine, "torque just before", "mN·m",
                               "half the stall torque", hp.stall_torque / 2, last.torque, 5));
  figure.claims.push_back(near(what + " collapses", engine, "rotation rate just before", "rev/s",
                               "half the free rate", hp.rotation_rate / 2, last.rotation_rate, 5));
}

void claim_imposed_force(FigureReport& figure, const Run& run, const Bur& bur,
                         const Outcome& outcome) {
  const Parameters& p = outcome.parameters;
  const Handpiece& hp = p.handpiece;
  const std::vector<StepRecord>& rows = outcome.replay.rows;
  const std::string engine = name_of(p.engine);
  const std::string what = "Imposed force";
  double fastest = 0, worst_rate = 0, torque_at_fastest = 0;
  std::size_t collapse = rows.size();
  for (std::size_t i = 1; i < rows.size(); ++i) {
    if (rows[i].stalled) collapse = std::min(collapse, i);
    if (rows[i].stalled || rows[i].torque <= 0) continue;
    worst_rate =
        std::max(worst_rate, std::abs(rows[i].rotation_rate -
                                      hp.rotation_rate * (1 - rows[i].torque / hp.stall_torque)));
  }
  figure.claims.push_back(near(what, engine, "N against N0 (1 - T/stall torque), of N0", "%",
                               "closed form", 0, 100 * worst_rate / hp.rotation_rate, 1e-3, 100));
  if (run.bur.rfind("cylinder:", 0) != 0) return;
  const GrindingProperties& t = p.tissue[0];
  const reference::Grinding g{t.specific_energy, t.force_ratio, hp.rotation_rate};
  double worst_torque = 0, worst_speed = 0;
  for (std::size_t i = 1; i < std::min(collapse, rows.size()); ++i) {
    // Wholly engaged: the half of the side, to the element's resolution.
    if (rows[i].contact_area[0] < 0.995 * units::kPi * bur.max_radius() * bur.head_length())
      continue;
    const Vec3 feed = rows[i].bur_velocity;
    if (feed.norm() == 0) continue;
    const double against = -rows[i].grinding_force.dot(feed.normalized());
    const auto point = reference::droop_cylinder_under_force(g, hp.stall_torque, bur.max_radius(),
                                                             bur.head_length(), against);
    if (!point) continue;
    worst_torque = std::max(worst_torque, std::abs(rows[i].torque - point->point.torque));
    worst_speed = std::max(worst_speed, std::abs(feed.norm() - point->speed));
    if (feed.norm() > fastest) {
      fastest = feed.norm();
      torque_at_fastest = rows[i].torque;
    }
  }
  const double best = reference::droop_cylinder_under_force(
                          g, hp.stall_torque, bur.max_radius(), bur.head_length(),
                          units::kPi * hp.stall_torque / (8 * t.force_ratio * bur.max_radius()))
                          ->speed;
  figure.claims.push_back(near(what, engine, "torque's largest deviation, of the stall torque", "%",
                               "closed form", 0, 100 * worst_torque / hp.stall_torque, kAim, 100));
  figure.claims.push_back(near(what, engine, "feed's largest deviation, of the fastest", "%",
                               "closed form", 0, 100 * worst_speed / best, kAim, 100));
  figure.claims.push_back(
      near(what, engine, "fastest feed", "mm/s", "closed form", best, fastest, kAim));
  figure.claims.push_back(near(what, engine, "torque at the fastest feed", "mN·m",
                               "half the stall torque", hp.stall_torque / 2, torque_at_fastest, 5));
  if (collapse < rows.size())
    figure.claims.push_back(
        near(what + " stalls", engine, "|F| at the stall", "N", "closed form",
             units::kPi * hp.stall_torque / (4 * t.force_ratio * bur.max_radius()) *
                 std::sqrt(1 + t.force_ratio * t.force_ratio),
             rows[collapse].grinding_force.norm(), kAim));
}

}  // namespace

FigureReport droop_figure(const Experiment& experiment, FigureContext& context) {
  const FigureOptions& o = context.options();
  FigureReport figure;
  std::vector<Outcome> outcomes = replay_runs(experiment, o.engines.front(), context);
  for (std::size_t i = 0; i < experiment.runs.size(); ++i) {
    const Run& run = experiment.runs[i];
    Outcome& outcome = outcomes[i];
    RunReport report = report_of(run, outcome, o.voxel, nullptr);
    report.trace = context.write_trace(experiment, run.name, run, outcome);
    std::string exact_file;
    if (run.drive == Drive::kDirect) {
      const std::vector<HandleSample> path = context.path(run, outcome.parameters);
      Exact drooped;
      claim_imposed_feed(figure, outcome,
                         exact_answer(run, outcome.parameters, path, o.bur_library), drooped);
      exact_file = context.write_exact(experiment, run.name + "-exact", path, drooped);
      report.exact = exact_file;
    } else {
      claim_imposed_force(figure, run, make_bur(run.bur, o.bur_library), outcome);
    }
    Plot plot;
    plot.file = experiment.name + "/" + run.name;
    plot.title = experiment.title + ", " + run.title;
    plot.panels = force_panels({{"level sets", report.trace, "", "run"}}, exact_file);
    plot.panels.push_back({"$N$ (rev/s)", {{"", report.trace, "rotation_rate_rev_s", "run"}}});
    plot.panels.push_back(
        {"feed $-v_y$ (mm/s)", {{"", report.trace, "bur_velocity_y_mm_s", "run", -1}}});
    plot.stalled = report.trace;
    figure.plots.push_back(plot);
    figure.runs.push_back(report);
  }
  return figure;
}

}  // namespace toothprep::figures
