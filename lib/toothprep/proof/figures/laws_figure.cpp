// Grinding laws beyond the paper's: a cylinder in a full slot at several feeds against the integral
// of its law over the bur's front, and the energy audit.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "toothprep/proof/figures/figure_context.h"
#include "toothprep/proof/reference/closed_forms.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"

namespace toothprep::figures {
namespace {

constexpr double kLawAim = 1;           // percent
constexpr double kTransient = 0.3;      // of a stretch, left out
constexpr std::size_t kLeastRows = 50;  // of a stretch
constexpr double kSameSpeed = 1e-6;

struct Feed {
  double speed = 0;  // mm/s
  std::size_t first = 0, last = 0;
};

// Stretches of one speed in contact, by the bur's own velocity, without their beginnings.
std::vector<Feed> feeds_of(const std::vector<StepRecord>& rows) {
  std::vector<Feed> feeds;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    const double speed = rows[i].bur_velocity.norm();
    if (!(speed > 0) || !(rows[i].torque > 0)) continue;
    const bool goes_on = !feeds.empty() && feeds.back().last + 1 == i &&
                         std::abs(speed - feeds.back().speed) <= kSameSpeed * speed;
    if (!goes_on) feeds.push_back({speed, i, i});
    feeds.back().last = i;
  }
  std::erase_if(feeds, [](const Feed& f) { return f.last - f.first < kLeastRows; });
  for (Feed& f : feeds)
    f.first += static_cast<std::size_t>(kTransient * static_cast<double>(f.last - f.first));
  return feeds;
}

// Against and across the feed, and the torque, on the mean.
reference::SteadyLoad level_of(const std::vector<StepRecord>& rows, const Feed& feed,
                               bool clockwise) {
  reference::SteadyLoad level{0, 0, 0};
  const double share = 1 / static_cast<double>(feed.last - feed.first + 1);
  for (std::size_t i = feed.first; i <= feed.last; ++i) {
    const Vec3 along = rows[i].bur_velocity.normalized();
    const Vec3 axis = rows[i].bur.orientation * Vec3::UnitZ();
    const Vec3 side = (clockwise ? 1 : -1) * axis.cross(along);
    level.against -= share * rows[i].grinding_force.dot(along);
    level.across += share * rows[i].grinding_force.dot(side);
    level.torque += share * rows[i].torque;
  }
  return level;
}

void claim_direct(FigureReport& figure, const Run& run, const Bur& bur, const Outcome& outcome) {
  const Parameters& p = outcome.parameters;
  const std::string engine = name_of(p.engine);
  const std::vector<Feed> feeds = feeds_of(outcome.replay.rows);
  if (feeds.size() < 2) throw Error(run.name + ": has fewer than two feeds in contact");
  for (const Feed& feed : feeds) {
    const auto exact = reference::cylinder_by_law(p.tissue[0], p.handpiece.rotation_rate,
                                                  bur.max_radius(), bur.head_length(), feed.speed);
    const auto is = level_of(outcome.replay.rows, feed, p.handpiece.clockwise);
    const std::string at = fmt::format(" at {:g} mm/s", std::round(1e6 * feed.speed) / 1e6);
    figure.claims.push_back(near(run.title, engine, "force against the feed" + at, "N",
                                 "integral of the law", exact.against, is.against, kLawAim));
    figure.claims.push_back(near(run.title, engine, "force across it" + at, "N",
                                 "integral of the law", exact.across, is.across, kLawAim,
                                 exact.against));
    figure.claims.push_back(near(run.title, engine, "torque" + at, "mN·m", "integral of the law",
                                 exact.torque, is.torque, kLawAim));
  }
}

// A spring holds the bur: what the tissue does to it is what the spring does.
void claim_coupled(FigureReport& figure, const Run& run, const Outcome& outcome) {
  const StepRecord& last = outcome.replay.rows.back();
  const Vec3 spring =
      outcome.parameters.coupling.stiffness * (last.handle.pose.position - last.bur.position);
  figure.claims.push_back(
      near(run.title, name_of(outcome.parameters.engine),
           "|force + k lag| at the end, of the force", "%", "balance", 0,
           100 * (last.grinding_force + spring).norm() / last.grinding_force.norm(), kLawAim, 100));
}

}  // namespace

FigureReport laws_figure(const Experiment& experiment, FigureContext& context) {
  const FigureOptions& o = context.options();
  FigureReport figure;
  std::vector<Outcome> outcomes = replay_runs(experiment, EngineKind::kLevelset, context);
  for (std::size_t i = 0; i < experiment.runs.size(); ++i) {
    const Run& run = experiment.runs[i];
    Outcome& outcome = outcomes[i];
    const std::string engine = name_of(outcome.parameters.engine);
    if (run.drive == Drive::kDirect)
      claim_direct(figure, run, make_bur(run.bur, o.bur_library), outcome);
    else
      claim_coupled(figure, run, outcome);
    figure.claims.push_back(near(run.title, engine, "work over energy of what was removed", "1",
                                 "energy audit", 1, outcome.replay.energy_ratio, kAuditAim));
    figure.claims.push_back(bound(run.title, engine,
                                  "steps in which force and velocity don't agree", "1", "the step",
                                  0, static_cast<double>(outcome.replay.totals.unsettled_steps)));
    RunReport report = report_of(run, outcome, o.voxel, nullptr);
    report.trace = context.write_trace(experiment, run.name, run, outcome);
    Plot plot;
    plot.file = experiment.name + "/" + run.name;
    plot.title = experiment.title + ", " + run.title;
    plot.panels = force_panels({{"level sets", report.trace, "", "run"}}, "");
    plot.panels.push_back(
        {"feed $-v_y$ (mm/s)", {{"", report.trace, "bur_velocity_y_mm_s", "run", -1}}});
    plot.stalled = report.trace;
    figure.plots.push_back(plot);
    figure.runs.push_back(report);
  }
  return figure;
}

}  // namespace toothprep::figures
