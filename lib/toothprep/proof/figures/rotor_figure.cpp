// A rotor with inertia: its rotation rate against an independent integration of
// 2 pi J dN/dt = T_drive(N) - T with the cutting torque T of the trace, spin-up and run-down times
// against closed forms, and the energy balance.
#include <algorithm>
#include <cmath>

#include "toothprep/proof/figures/figure_context.h"
#include "toothprep/step/core/units.h"

namespace toothprep::figures {
namespace {

constexpr int kSubsteps = 50;              // of a step, of the integral
constexpr double kRateAim = 1;             // percent of N0
constexpr double kTimeAim = 1;             // percent
constexpr double kBalanceAim = 1;          // percent
const double kShare = 1 - std::exp(-1.0);  // of N0, whose time is the free time constant

double drive_torque(const Handpiece& h, bool pedal, double rate) {
  const double x = rate / h.rotation_rate;
  if (!pedal) return -2 * units::kPi * h.rotor_inertia * h.rotation_rate / h.run_down;
  if (h.model == HandpieceModel::kDroop)
    return h.stall_torque * (1 - std::pow(x, h.droop_exponent));
  return h.stall_torque;
}

bool pedal_of(const StepRecord& row) { return row.handle.buttons & kPedalButton; }

// N at the end of every row, by small steps of the midpoint rule from the first.
std::vector<double> integral(const std::vector<StepRecord>& rows, const Handpiece& h, double step) {
  std::vector<double> rate{pedal_of(rows.front()) ? h.rotation_rate : 0};
  const double dt = step / kSubsteps;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    double n = rate.back();
    const bool pedal = pedal_of(rows[i]);
    const auto slope = [&](double at) {
      return (drive_torque(h, pedal, at) - rows[i].torque) / (2 * units::kPi * h.rotor_inertia);
    };
    for (int k = 0; k < kSubsteps; ++k)
      n = std::clamp(n + dt * slope(n + dt / 2 * slope(n)), 0.0, h.rotation_rate);
    rate.push_back(n);
  }
  return rate;
}

// The time from the first row in which `begins` holds to the first after it in which `ends` does.
template <typename Begins, typename Ends>
double time_between(const std::vector<StepRecord>& rows, const Begins& begins, const Ends& ends) {
  const auto from = std::find_if(rows.begin(), rows.end(), begins);
  const auto to = std::find_if(from, rows.end(), ends);
  return from == rows.end() || to == rows.end() ? std::nan("")
                                                : to->handle.time - from->handle.time;
}

// In which a free rotor comes from rest to kShare of N0, s.
double spin_up_time(const Handpiece& h) {
  const double constant = 2 * units::kPi * h.rotor_inertia * h.rotation_rate / h.stall_torque;
  if (h.model == HandpieceModel::kFixed) return kShare * constant;
  return constant * (h.droop_exponent == 2 ? std::atanh(kShare) : 1);
}

struct Balance {
  double driven = 0, ground = 0, gained = 0;  // mJ
};
// Of a drooping drive, whose torque follows from the rate. (A governor's does not.)
Balance balance_of(const std::vector<StepRecord>& rows, const Handpiece& h, double step) {
  Balance b;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    const double n = rows[i].rotation_rate, before = rows[i - 1].rotation_rate;
    b.driven += step * 2 * units::kPi * n * drive_torque(h, pedal_of(rows[i]), n);
    b.ground += step * 2 * units::kPi * n * rows[i].torque;
    b.gained += 2 * units::kPi * units::kPi * h.rotor_inertia * (n * n - before * before);
  }
  return b;
}

void claim_rotor(FigureReport& figure, const Run& run, const Outcome& outcome,
                 const std::vector<double>& exact) {
  const Handpiece& h = outcome.parameters.handpiece;
  const auto& rows = outcome.replay.rows;
  const std::string engine = name_of(outcome.parameters.engine);
  const double n0 = h.rotation_rate, step = outcome.parameters.time_step;
  double apart = 0, slowest = n0;
  bool fast = false;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    apart = std::max(apart, std::abs(rows[i].rotation_rate - exact[i]));
    fast = fast || rows[i].rotation_rate > 0.99 * n0;
    if (fast && pedal_of(rows[i])) slowest = std::min(slowest, rows[i].rotation_rate);
  }
  const auto put = [&](Claim claim) { figure.claims.push_back(std::move(claim)); };
  put(bound(run.title, engine, "largest deviation of the rotation rate, of N0", "%",
            "equation of motion", kRateAim, 100 * apart / n0));
  put(near(run.title, engine, "time to 63 % of N0", "s", "closed form", spin_up_time(h),
           time_between(rows, pedal_of,
                        [&](const StepRecord& r) { return r.rotation_rate >= kShare * n0; }),
           kTimeAim));
  // From the last row with the pedal pressed; a spring still presses a coupled bur sideways.
  if (run.drive == Drive::kDirect) {
    const auto last = std::find_if(rows.rbegin(), rows.rend(), pedal_of);
    const double from = last->rotation_rate, released = last->handle.time;
    put(near(run.title, engine, "time to rest with the pedal up", "s", "closed form",
             h.run_down * from / n0,
             time_between(
                 rows, [&](const StepRecord& r) { return r.handle.time >= released; },
                 [&](const StepRecord& r) { return r.rotation_rate <= 0; }),
             kTimeAim));
  }
  if (h.model == HandpieceModel::kDroop) {
    put(bound(run.title, engine, "lowest rate in the slot, of N0", "%", "it slows down", 95,
              100 * slowest / n0));
    const Balance b = balance_of(rows, h, step);
    put(near(run.title, engine, "work of cutting and kinetic energy over work of the drive", "1",
             "energy balance", 1, (b.ground + b.gained) / b.driven, kBalanceAim));
  }
  put(near(run.title, engine, "work over energy of what was removed", "1", "energy audit", 1,
           outcome.replay.energy_ratio, kAuditAim));
}

}  // namespace

FigureReport rotor_figure(const Experiment& experiment, FigureContext& context) {
  FigureReport figure;
  std::vector<Outcome> outcomes = replay_runs(experiment, EngineKind::kLevelset, context);
  for (std::size_t i = 0; i < experiment.runs.size(); ++i) {
    const Run& run = experiment.runs[i];
    Outcome& outcome = outcomes[i];
    const auto& rows = outcome.replay.rows;
    const std::vector<double> exact =
        integral(rows, outcome.parameters.handpiece, outcome.parameters.time_step);
    claim_rotor(figure, run, outcome, exact);
    RunReport report = report_of(run, outcome, context.options().voxel, nullptr);
    report.trace = context.write_trace(experiment, run.name, run, outcome);
    std::vector<double> time;
    for (const StepRecord& row : rows) time.push_back(row.handle.time);
    const std::string integrated = context.write_series(
        experiment, run.name + "-integral", {"time_s", "rotation_rate_rev_s"}, {time, exact});
    Plot plot;
    plot.file = experiment.name + "/" + run.name;
    plot.title = experiment.title + ", " + run.title;
    plot.panels.push_back({"rotation rate (rev/s)",
                           {{"step", report.trace, "rotation_rate_rev_s", "run"},
                            {"integral", integrated, "rotation_rate_rev_s", "exact"}}});
    plot.panels.push_back({"torque (mN m)", {{"", report.trace, "torque_mNm", "run"}}});
    figure.plots.push_back(plot);
    figure.runs.push_back(report);
  }
  return figure;
}

}  // namespace toothprep::figures
