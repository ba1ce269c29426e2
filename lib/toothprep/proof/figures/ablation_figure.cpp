// The paper's arguments for its method, each by leaving out what it argues for: the second layer of
// bur voxels (section 5.1), backward Euler (Eqs 15 to 18), an unfiltered velocity and the coupling
// itself (section 4). All variants on the same path, with the same figures.
//
// Each runs twice: along the path itself, where exact answers are known, and in the loop closed by
// the simulated device and hand.
#include <algorithm>
#include <cmath>

#include "toothprep/proof/figures/ablated_session.h"
#include "toothprep/proof/figures/figure_context.h"
#include "toothprep/proof/reference/step_limits.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/device/closed_loop.h"
#include "toothprep/tools/device/high_pass_rms.h"

namespace toothprep::figures {
namespace {

constexpr double kWindow = 3;        // s before the handle stops: where the force is judged
constexpr double kRippleCorner = 2;  // Hz, as the voxel effect of the other figures
constexpr double kFall = 0.367879;   // 1/e: fallen by 63 %
constexpr double kContactLost = 10;  // percent of the steps: ours
constexpr double kFlicker = 10;      // percent of the mean force, above 2 Hz: ours
constexpr double kLagAim = 1, kVoxelAimed = 3;  // percent, of the lag
constexpr double kNoContact = 1e-9;             // N
constexpr double kNoRipple = 1e-3;              // percent: rounding, nothing to take away
constexpr double kLessRipple = 10;              // percent: ours

struct Ablated {
  Run run;
  Parameters parameters;
  std::vector<HandleSample> path;
  std::size_t stop = 0;  // last row at which the handle moves
  Exact exact;
  std::vector<StepRecord> rows;  // along the path, as far as it went
  ClosedLoopSeries loop;
  double device_force_limit = 0;
  // The figures of the table, in the order of kColumns; NaN: none.
  double effect = std::nan(""), ripple = std::nan(""), share = std::nan(""), lost = std::nan(""),
         energy = std::nan(""), jump = std::nan(""), vibration = std::nan(""), late = std::nan(""),
         lag = std::nan("");
  double device_vibration = std::nan(""), device_jump = std::nan(""),
         device_saturated = std::nan(""), diverged = std::nan("");

  bool whole() const { return !(diverged >= 0); }
  bool ablated() const {
    return run.ablation.layers != Layers::kTwo ||
           run.ablation.integrator != Integrator::kBackward || run.ablation.filter_hz > 0 ||
           run.ablation.equal_area > 0;
  }
};

const std::vector<std::string> kColumns = {"voxel effect %",
                                           "above 2 Hz %",
                                           "mean force of exact %",
                                           "steps without contact %",
                                           "energy ratio",
                                           "largest jump N",
                                           "RMS above 20 Hz N",
                                           "63 % less after s",
                                           "lag mm",
                                           "device: RMS above 20 Hz N",
                                           "device: largest jump N",
                                           "device: at its limit %",
                                           "diverges after s"};
std::vector<double> values_of(const Ablated& v) {
  return {v.effect,      v.ripple,           v.share,   v.lost, v.energy,
          v.jump,        v.vibration,        v.late,    v.lag,  v.device_vibration,
          v.device_jump, v.device_saturated, v.diverged};
}

double energy_removed(const Parameters& p, const PerTissue<double>& removed) {
  double energy = 0;
  for (int k = 0; k < kTissueCount; ++k) energy += p.tissue[k].specific_energy * removed[k];
  return energy;
}

void run_on_path(Ablated& v, const LayeredTooth& tooth, const FigureOptions& o) {
  const Bur bur = make_bur(v.run.bur, o.bur_library);
  Workpiece workpiece(tooth);
  AblatedSession session(bur, workpiece, v.parameters, v.run.drive, v.run.ablation, v.path.front());
  v.rows.reserve(v.path.size());
  v.rows.emplace_back();
  v.rows.front().handle = v.path.front();
  v.rows.front().bur = v.path.front().pose;
  for (std::size_t i = 1; i < v.path.size() && v.whole(); ++i) {
    v.rows.push_back(session.step(v.path[i]));
    if (session.diverged()) v.diverged = v.path[i].time - v.path.front().time;
  }
  const double removed = energy_removed(v.parameters, session.removed());
  if (v.whole() && removed > 0) v.energy = session.torque_work() / removed;
}

void run_on_device(Ablated& v, const LayeredTooth& tooth, const Experiment& experiment,
                   const FigureOptions& o) {
  PhantomModel device = experiment.device;
  device.rate = 1 / v.parameters.time_step;
  std::vector<Vec3> intended;
  for (std::size_t i = 0; i <= v.stop; ++i) intended.push_back(v.path[i].pose.position);
  const Bur bur = make_bur(v.run.bur, o.bur_library);
  Workpiece workpiece(tooth);
  SimulatedPhantom phantom(device, experiment.hand, intended.front());
  HandleSample handle = v.path.front();
  handle.pose.position = phantom.encoder_position();
  AblatedSession session(bur, workpiece, v.parameters, v.run.drive, v.run.ablation, handle);
  v.loop = run_closed_loop(phantom, intended, [&](std::size_t n, const Vec3& encoder) -> Vec3 {
    handle = v.path[n];
    handle.pose.position = encoder;
    const Vec3 force = session.step(handle).device_force;
    return force.allFinite() ? force : Vec3(Vec3::Zero());
  });
  if (session.diverged()) return;
  const double settling = v.loop.time.back() - kWindow;
  const ClosedLoopFigures f =
      closed_loop_figures(v.loop, device, intended.back() - intended.front(), settling);
  v.device_vibration = f.force_rms_above_20;
  v.device_saturated = 100 * f.saturated_fraction;
  v.device_jump = 0;
  for (std::size_t n = 1; n < v.loop.force.size(); ++n)
    if (v.loop.time[n] > settling)
      v.device_jump = std::max(v.device_jump, (v.loop.force[n] - v.loop.force[n - 1]).norm());
}

// RMS over three axes of what is above `corner`, N.
double rms_of(const std::vector<Vec3>& force, double rate, double corner) {
  double sum = 0;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> component;
    for (const Vec3& f : force) component.push_back(f[axis]);
    const double rms = rms_above(component, rate, corner);
    sum += rms * rms;
  }
  return std::sqrt(sum);
}

// How long after the handle stopped the force is 63 % less, s; NaN: never.
template <class ForceAt>
double fall_time(const Ablated& v, std::size_t rows, const ForceAt& force) {
  const double before = force(v.stop).norm();
  for (std::size_t i = v.stop; i < rows; ++i)
    if (force(i).norm() <= kFall * before) return v.path[i].time - v.path[v.stop].time;
  return std::nan("");
}

void judge_path(Ablated& v) {
  if (!v.whole()) return;
  const double rate = 1 / v.parameters.time_step;
  const auto window = static_cast<std::size_t>(std::lround(kWindow * rate));
  if (v.stop < window) throw Error("ablations: the handle must move for at least 3 s");
  std::vector<Vec3> off, felt;
  Vec3 mean = Vec3::Zero(), exact = Vec3::Zero();
  std::size_t without = 0;
  double sum = 0;
  v.lag = 0;
  for (std::size_t i = v.stop - window; i <= v.stop; ++i) {
    off.push_back(v.rows[i].grinding_force - v.exact.force[i]);
    felt.push_back(v.rows[i].device_force);
    sum += off.back().squaredNorm();
    mean += v.rows[i].grinding_force;
    exact += v.exact.force[i];
    without += v.rows[i].grinding_force.norm() < kNoContact;
  }
  const double scale = v.exact.force[v.stop].norm();
  const auto n = static_cast<double>(off.size());
  v.effect = 100 * std::sqrt(sum / n) / scale;
  v.ripple = 100 * rms_of(off, rate, kRippleCorner) / scale;
  v.share = 100 * mean.norm() / exact.norm();
  v.vibration = rms_of(felt, rate, kVibrationCorner);
  v.lost = 100 * static_cast<double>(without) / n;
  v.jump = 0;
  for (std::size_t i = 1; i <= v.stop; ++i) {
    v.jump = std::max(v.jump, (v.rows[i].device_force - v.rows[i - 1].device_force).norm());
    v.lag = std::max(v.lag, (v.rows[i].handle.pose.position - v.rows[i].bur.position).norm());
  }
  v.late = fall_time(v, v.rows.size(), [&](std::size_t i) { return v.rows[i].device_force; });
}

// The resistance at which a bur on its spring begins to grow, by bisection of what it does: starts
// beside a handle at rest, and is larger or smaller after a while.
double measured_limit(Integrator integrator, const Coupling& coupling, double h, double low,
                      double high) {
  const auto grows = [&](double resistance) {
    CouplingState s{Vec3(1e-3, 0, 0), Vec3::Zero(), Vec3::Zero(), Vec3::Zero()};
    const Mat3 drag = -resistance * Mat3::Identity();
    double early = 0, late = 0;
    constexpr int kSteps = 40000;
    for (int i = 0; i < kSteps; ++i) {
      const Vec3 before = s.velocity;
      s.velocity = explicit_velocity(coupling, h, s, drag, Vec3::Zero());
      s.position += h * (integrator == Integrator::kExplicit ? before : s.velocity);
      const double size = std::max(s.position.norm(), h * s.velocity.norm());
      if (!(size < 1e6)) return true;
      (i < kSteps / 2 ? early : late) = std::max(i < kSteps / 2 ? early : late, size);
    }
    return late > early;
  };
  const bool above = grows(high);  // the growing side is `high`, or `low` for a lower limit
  for (int i = 0; i < 40; ++i) {
    const double middle = (low + high) / 2;
    (grows(middle) == above ? high : low) = middle;
  }
  return (low + high) / 2;
}

void claim_integrators(FigureReport& figure, const Parameters& p) {
  const Coupling& c = p.coupling;
  const double h = p.time_step;
  const auto range = reference::explicit_euler_range(c.bur_mass, c.stiffness, h);
  const double between = std::sqrt(range.low * range.high);
  const std::string claim = "A bur on its spring against F = -B v: where explicit schemes diverge";
  figure.claims.push_back(near(claim, "", "explicit Euler, least B", "N·s/mm", "closed form k h",
                               range.low, measured_limit(Integrator::kExplicit, c, h, between, 0),
                               1));
  figure.claims.push_back(
      near(claim, "", "explicit Euler, greatest B", "N·s/mm", "closed form 2 m/h + k h/2",
           range.high, measured_limit(Integrator::kExplicit, c, h, between, 10 * range.high), 1));
  const auto semi = reference::semi_implicit_euler_range(c.bur_mass, c.stiffness, h);
  figure.claims.push_back(
      near(claim, "", "semi-implicit Euler, greatest B", "N·s/mm", "closed form 2 m/h - k h/2",
           semi.high, measured_limit(Integrator::kSemiImplicit, c, h, between, 10 * semi.high), 1));
}

// Direct rendering of F = -B w on a device without friction, counts and hand: the velocity's
// growth over the second half of the path.
double growth(double damping, double cutoff, double mass, double h) {
  PhantomModel device;
  device.apparent_mass = mass;
  device.damping = device.friction = device.encoder_count = 0;
  device.force_limit = 1e9;
  device.rate = 1 / h;
  device.sub_steps = 1;
  HandModel hand;
  hand.mass = hand.damping = 0;
  hand.stiffness = 1e-4;
  SimulatedPhantom phantom(device, hand, Vec3::Zero());
  std::vector<Vec3> intended;
  for (int n = 0; n < 4000; ++n) intended.emplace_back(std::min(n, 20) * 0.01, 0, 0);
  const double share = cutoff > 0 ? -std::expm1(-2 * units::kPi * cutoff * h) : 1;
  Vec3 last = Vec3::Zero(), filtered = Vec3::Zero();
  const ClosedLoopSeries s =
      run_closed_loop(phantom, intended, [&](std::size_t, const Vec3& encoder) -> Vec3 {
        filtered += share * ((encoder - last) / h - filtered);
        last = encoder;
        return -damping * filtered;
      });
  double early = 0, late = 0;
  for (std::size_t n = 1000; n < s.velocity.size(); ++n)
    (n < 2500 ? early : late) = std::max(n < 2500 ? early : late, s.command[n].norm());
  return late / early;
}

void claim_filters(FigureReport& figure, const Experiment& experiment,
                   const std::vector<Ablated>& variants) {
  const double mass = experiment.device.apparent_mass;
  for (const Ablated& v : variants) {
    const double cutoff = v.run.ablation.filter_hz, h = v.parameters.time_step;
    if (!(cutoff > 0)) continue;
    const double limit = reference::filtered_rendering_limit(mass, h);
    const std::string claim = "A filter doesn't move the limit of direct rendering: " + v.run.title;
    figure.claims.push_back(bound(claim, "", "growth at 0.97 of 2 M/T", "1", "closed form", 1,
                                  growth(0.97 * limit, cutoff, mass, h)));
    figure.claims.push_back(bound(claim, "", "growth at 1.03 of 2 M/T", "1", "closed form", 1,
                                  growth(1.03 * limit, cutoff, mass, h), true));
    figure.claims.push_back(near("A filter delays the force: " + v.run.title, name_of(v.run.engine),
                                 "time until the force is 63 % less", "s",
                                 "closed form 1/(2 pi f), to a step", 1 / (2 * units::kPi * cutoff),
                                 v.late, 100 * h * 2 * units::kPi * cutoff));
    figure.claims.push_back(bound("A filtered velocity vibrates too: " + v.run.title,
                                  name_of(v.run.engine), "RMS of the device's force above 20 Hz",
                                  "N", "the paper; the device's friction is ours",
                                  experiment.device.friction, v.device_vibration, true));
  }
}

void claim_variant(FigureReport& figure, const Experiment& experiment, const Ablated& v) {
  const std::string engine = name_of(v.run.engine);
  if (!v.ablated()) {
    figure.claims.push_back(near("Contact is never lost: " + v.run.title, engine,
                                 "steps without contact", "%", "the paper", 0, v.lost, 0, 100));
    if (v.run.drive == Drive::kDirect)
      figure.claims.push_back(bound("Direct rendering vibrates: " + v.run.title, engine,
                                    "RMS of the device's force above 20 Hz", "N",
                                    "the paper; the device's friction is ours",
                                    experiment.device.friction, v.device_vibration, true));
    else
      figure.claims.push_back(bound("The coupling doesn't vibrate: " + v.run.title, engine,
                                    "RMS of the device's force above 20 Hz", "N",
                                    "the paper; the device's friction is ours",
                                    experiment.device.friction, v.device_vibration));
    if (v.run.drive == Drive::kCoupled)
      figure.claims.push_back(
          near("The coupling lags: " + v.run.title, engine, "time until the force is 63 % less",
               "s", "exact integral",
               fall_time(v, v.exact.force.size(), [&](std::size_t i) { return v.exact.force[i]; }),
               v.late, v.run.engine == EngineKind::kVoxel ? kVoxelAimed : kLagAim));
    return;
  }
  if (v.run.ablation.layers != Layers::kTwo) {
    figure.claims.push_back(bound("Without the second layer contact is lost: " + v.run.title,
                                  engine, "steps without contact", "%", "the paper; 10 % is ours",
                                  kContactLost, v.lost, true));
    figure.claims.push_back(bound("Without the second layer the force flickers: " + v.run.title,
                                  engine, "RMS above 2 Hz, of the force's own mean", "%",
                                  "the paper; 10 % is ours", kFlicker, 100 * v.ripple / v.share,
                                  true));
  }
  if (v.run.ablation.equal_area > 0 && v.run.drive == Drive::kDirect)
    figure.claims.push_back(
        near("The same area for every boundary voxel gives the force: " + v.run.title, engine,
             "mean force, of the exact one", "%", "exact integral", 100, v.share, kVoxelAimed));
  if (v.run.ablation.integrator != Integrator::kBackward)
    figure.claims.push_back(bound("Without backward Euler the bur diverges: " + v.run.title, engine,
                                  "time until then (none: the whole path)", "s", "the paper",
                                  v.path.back().time - v.path.front().time,
                                  v.whole() ? std::nan("") : v.diverged));
}

// What the coupling does to the voxel effect: runs that differ in their drive alone.
void claim_ripples(FigureReport& figure, const std::vector<Ablated>& variants) {
  for (const Ablated& coupled : variants)
    for (const Ablated& direct : variants) {
      const Run &a = coupled.run, &b = direct.run;
      if (a.drive != Drive::kCoupled || b.drive != Drive::kDirect || a.engine != b.engine ||
          a.bur != b.bur || a.ablation != b.ablation || a.ablation.layers != Layers::kTwo ||
          !(direct.ripple > kNoRipple))
        continue;
      figure.claims.push_back(bound("The coupling takes the ripple away: " + a.title,
                                    name_of(a.engine), "RMS above 2 Hz, of that in direct drive",
                                    "%", "the paper; a tenth is ours", kLessRipple,
                                    100 * coupled.ripple / direct.ripple));
    }
}

// Against the feed, N.
void add_curves(FigureReport& figure, const Experiment& experiment, FigureContext& context,
                const std::vector<Ablated>& variants) {
  Plot path, device;
  path.file = experiment.name + "/path";
  path.title = experiment.title + ": along the path";
  device.file = experiment.name + "/device";
  device.title = experiment.title + ": on the simulated device";
  for (const Ablated& v : variants) {
    const Vec3 against = (v.path.front().pose.position - v.path[v.stop].pose.position).normalized();
    std::vector<std::vector<double>> columns(4);
    for (std::size_t i = 0; i < v.path.size(); ++i) {
      columns[0].push_back(v.path[i].time);
      columns[1].push_back(i < v.rows.size() ? v.rows[i].device_force.dot(against) : 0);
      columns[2].push_back(v.exact.force[i].dot(against));
      columns[3].push_back(i < v.loop.force.size() ? v.loop.force[i].dot(against) : 0);
    }
    if (!v.whole()) columns[1].assign(columns[1].size(), 0);  // nothing to draw to scale
    const std::string file = context.write_series(
        experiment, v.run.name, {"time_s", "force_N", "exact_N", "device_force_N"}, columns);
    const std::string label = v.run.name + "\n(N)";
    if (v.whole()) {
      path.panels.push_back(
          {label, {{"", file, "force_N", "run"}, {"exact", file, "exact_N", "thin"}}});
      device.panels.push_back({label, {{"", file, "device_force_N", "run"}}});
    }
  }
  if (path.panels.empty()) return;  // all diverged
  device.to_s = variants.front().path[variants.front().stop].time;
  figure.plots = {path, device};
}

}  // namespace

FigureReport ablation_figure(const Experiment& experiment, FigureContext& context) {
  const FigureOptions& o = context.options();
  FigureReport figure;
  std::vector<Ablated> variants;
  for (const Run& run : experiment.runs) {
    if (std::find(o.engines.begin(), o.engines.end(), run.engine) == o.engines.end()) continue;
    Ablated v;
    v.run = run;
    v.parameters = parameters_of(run, o.base);
    v.parameters.engine = run.engine;
    if (run.engine != EngineKind::kVoxel) v.parameters.trailing_elements = false;
    v.path = context.path(run, v.parameters);
    for (std::size_t i = 1; i < v.path.size(); ++i)
      if (v.path[i].pose.position != v.path[i - 1].pose.position) v.stop = i;
    variants.push_back(std::move(v));
  }
  std::vector<ExactTask> tasks;
  for (const Ablated& v : variants) tasks.push_back({v.run, v.parameters, v.path});
  std::vector<Exact> exact = exact_answers(tasks, o.bur_library);
  for (std::size_t i = 0; i < variants.size(); ++i) variants[i].exact = std::move(exact[i]);
  std::vector<FigureContext::Job> jobs;
  for (Ablated& v : variants)
    jobs.push_back({experiment.name,
                    [&] {
                      const LayeredTooth tooth = context.specimen(experiment, v.run, o.voxel);
                      run_on_path(v, tooth, o);
                      judge_path(v);
                      run_on_device(v, tooth, experiment, o);
                    },
                    2});
  context.run(jobs);

  MetricTable table;
  table.title = "Along the path, and on the simulated device";
  table.columns = kColumns;
  for (const Ablated& v : variants) table.rows.push_back({v.run.name, v.run.title, values_of(v)});
  figure.tables.push_back(table);
  add_curves(figure, experiment, context, variants);
  for (const Ablated& v : variants) claim_variant(figure, experiment, v);
  claim_ripples(figure, variants);
  if (!variants.empty()) claim_integrators(figure, variants.front().parameters);
  claim_filters(figure, experiment, variants);
  return figure;
}

}  // namespace toothprep::figures
