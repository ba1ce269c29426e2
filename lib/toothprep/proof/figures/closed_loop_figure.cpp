// The loop closed by a simulated device and hand (figure 15): direct rendering against the
// coupling, and where each of them is stable.
#include <array>
#include <cmath>

#include "toothprep/proof/figures/figure_context.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/device/stability_map.h"

namespace toothprep::figures {
namespace {

constexpr double kSettlingShare = 0.4;  // of the path: the bur is engaged and the force has risen
constexpr double kPerMetre = 1e3;       // N·s/mm to N·s/m, N/mm to N/m

struct Loop {
  Outcome outcome;
  ClosedLoopSeries series;
  ClosedLoopFigures figures;
};

Loop run_loop(const Experiment& experiment, const Run& run, const Parameters& parameters,
              FigureContext& context) {
  PhantomModel device = experiment.device;
  device.rate = 1 / parameters.time_step;
  const std::vector<HandleSample> path = context.path(run, parameters);
  std::vector<Vec3> intended;
  for (const HandleSample& s : path) intended.push_back(s.pose.position);

  Loop loop;
  loop.outcome.parameters = parameters;
  LayeredTooth tooth = context.specimen(experiment, run, context.options().voxel);
  loop.outcome.tooth_sha256 = tooth_sha256(tooth);
  const Bur bur = make_bur(run.bur, context.options().bur_library);
  SimulatedPhantom phantom(device, experiment.hand, intended.front());
  LevelSet cut;
  {
    Workpiece workpiece(tooth);
    HandleSample handle = path.front();
    handle.pose.position = phantom.encoder_position();
    Session session(bur, workpiece, parameters, run.drive, handle);
    std::vector<StepRecord>& rows = loop.outcome.replay.rows;
    rows.reserve(path.size());
    rows.push_back(session.initial());
    loop.series =
        run_closed_loop(phantom, intended, [&](std::size_t n, const Vec3& encoder) -> Vec3 {
          handle = path[n];
          handle.pose.position = encoder;
          rows.push_back(session.step(handle));
          return rows.back().device_force;
        });
    session.finish(rows.back());
    loop.outcome.replay.totals = session.totals();
    cut = workpiece.cut();
  }
  ReplayResult& r = loop.outcome.replay;
  r.removed_energy = energy_of_removal(parameters, r.totals, r.totals.removed);
  r.energy_ratio = r.removed_energy > 0 ? r.totals.torque_work / r.removed_energy : std::nan("");
  r.seconds_simulated = path.back().time - path.front().time;
  apply_cut(tooth, cut);
  loop.outcome.prepared = std::move(tooth);
  loop.figures = closed_loop_figures(loop.series, device, intended.back() - intended.front(),
                                     kSettlingShare * r.seconds_simulated);
  return loop;
}

const char* text(LoopVerdict verdict) {
  switch (verdict) {
    case LoopVerdict::kStable:
      return "stable";
    case LoopVerdict::kVibrates:
      return "vibrates";
    case LoopVerdict::kUnstable:
      break;
  }
  return "unstable";
}

MapPlot map_plot(const StabilityMap& map, const std::string& file, const std::string& title) {
  MapPlot plot;
  plot.file = file;
  plot.title = title;
  plot.x_label = "damping $B$ (N·s/m)";
  plot.value_label = "RMS of the force above 20 Hz (N)";
  for (const double b : map.dampings) plot.x.push_back(b * kPerMetre);
  for (std::size_t row = 0; row < map.others.size(); ++row) {
    std::vector<double> values;
    std::vector<std::string> verdicts;
    for (std::size_t column = 0; column < map.dampings.size(); ++column) {
      values.push_back(map.at(row, column).force_rms_above_20);
      verdicts.push_back(text(map.at(row, column).verdict));
    }
    plot.values.push_back(values);
    plot.verdicts.push_back(verdicts);
  }
  return plot;
}

void add_maps(FigureReport& figure, const Experiment& experiment, const Parameters& parameters) {
  LinearDamperExperiment base;
  base.phantom = experiment.device;
  base.phantom.rate = 1 / parameters.time_step;
  base.hand = experiment.hand;
  base.coupling = parameters.coupling;
  const PhantomModel& device = base.phantom;

  base.rendering = Rendering::kDirect;
  MapPlot direct = map_plot(
      stability_map(base, experiment.map.dampings, MapAxis::kApparentMass, experiment.map.masses),
      experiment.name + "/map-direct", "Direct rendering of $F = -Bv$");
  direct.y_label = "apparent mass of the device (g)";
  MapPlot::Line linear{"linear limit", {}, {}}, friction{"$2 f_c T/D$", {}, {}};
  for (const double m : experiment.map.masses) {
    direct.y.push_back(units::to_gram(m));
    linear.x.push_back(kPerMetre * linear_damping_limit(m + experiment.hand.mass,
                                                        parameters.time_step, device.delay_ticks));
    linear.y.push_back(units::to_gram(m));
    friction.y.push_back(units::to_gram(m));
    friction.x.push_back(kPerMetre * friction_damping_limit(device.friction, parameters.time_step,
                                                            device.encoder_count));
  }
  direct.lines = {linear, friction};
  figure.maps.push_back(direct);

  base.rendering = Rendering::kCoupled;
  MapPlot coupled = map_plot(stability_map(base, experiment.map.dampings,
                                           MapAxis::kCouplingStiffness, experiment.map.stiffnesses),
                             experiment.name + "/map-coupled", "Coupled rendering of $F = -Bv$");
  coupled.y_label = "coupling stiffness $k$ (N/mm)";
  coupled.y = experiment.map.stiffnesses;
  const double limit =
      coupling_stiffness_limit(device.damping + experiment.hand.damping, parameters.time_step);
  coupled.lines = {{"$2b/T$", {coupled.x.front(), coupled.x.back()}, {limit, limit}}};
  if (device.encoder_count > 0) {
    const double count = friction_stiffness_limit(device.friction, device.encoder_count);
    coupled.lines.push_back({"$2 f_c/D$", {coupled.x.front(), coupled.x.back()}, {count, count}});
  }
  figure.maps.push_back(coupled);
}

// Points of the map with known answers, with a hand that adds no mass.
void claim_known_points(FigureReport& figure, const Experiment& experiment,
                        const Parameters& parameters) {
  LinearDamperExperiment e;
  e.phantom = experiment.device;
  e.phantom.rate = 1 / parameters.time_step;
  e.hand = experiment.hand;
  e.hand.mass = 0;
  e.coupling = parameters.coupling;
  const double mass = experiment.device.apparent_mass;
  const double linear =
      linear_damping_limit(mass, parameters.time_step, experiment.device.delay_ticks);
  const double quiet = friction_damping_limit(experiment.device.friction, parameters.time_step,
                                              experiment.device.encoder_count);
  e.rendering = Rendering::kDirect;
  e.damping = 0.95 * quiet;
  figure.claims.push_back(near(
      "Direct rendering is quiet below 2 f_c T/D", "",
      "samples that move backward at B = " +
          std::to_string(std::lround(10 * e.damping * kPerMetre) / 10.0).substr(0, 4) + " N·s/m",
      "%", "closed form", 0, 100 * run_linear_damper(e).figures.backward_fraction, 0.2, 100));
  e.damping = 1.1 * linear;
  figure.claims.push_back(bound(
      "Direct rendering is unstable above the linear limit 2 M/T", "",
      "samples at the force limit at B = " + std::to_string(std::lround(e.damping * kPerMetre)) +
          " N·s/m",
      "%", "closed form", 1, 100 * run_linear_damper(e).figures.saturated_fraction, true));
  e.rendering = Rendering::kCoupled;
  for (const double b : {0.01, 1.0, 4.0, 9.0}) {
    e.damping = b;
    const ClosedLoopFigures f = run_linear_damper(e).figures;
    figure.claims.push_back(near("The coupling stays quiet", "",
                                 "samples that move backward at B = " +
                                     std::to_string(std::lround(b * kPerMetre)) + " N·s/m",
                                 "%", "the paper", 0, 100 * f.backward_fraction, 0.2, 100));
  }
}

}  // namespace

FigureReport closed_loop_figure(const Experiment& experiment, FigureContext& context) {
  const FigureOptions& o = context.options();
  FigureReport figure;
  const Run& given = experiment.runs.front();
  Parameters parameters = parameters_of(given, o.base);
  parameters.engine = o.engines.front();
  std::array<Run, 2> runs = {given, given};
  runs[0].name = "direct";
  runs[0].drive = Drive::kDirect;
  runs[1].name = "coupled";
  runs[1].drive = Drive::kCoupled;
  std::array<Loop, 2> loops;
  context.run(
      {{experiment.name, [&] { loops[0] = run_loop(experiment, runs[0], parameters, context); }},
       {experiment.name, [&] { loops[1] = run_loop(experiment, runs[1], parameters, context); }},
       {experiment.name, [&] { add_maps(figure, experiment, parameters); }}});

  const std::string engine = name_of(parameters.engine);
  Plot plot;
  plot.file = experiment.name + "/forces";
  plot.title = experiment.title;
  plot.panels = {
      {"device $F_y$ (N)\ndirect", {}}, {"device $F_y$ (N)\ncoupled", {}}, {"handle $y$ (mm)", {}}};
  for (int i = 0; i < 2; ++i) {
    Loop& loop = loops[i];
    RunReport report = report_of(runs[i], loop.outcome, o.voxel, nullptr);
    report.trace = context.write_trace(experiment, runs[i].name, runs[i], loop.outcome);
    figure.runs.push_back(report);
    std::vector<std::vector<double>> columns(10);
    for (std::size_t n = 0; n < loop.series.time.size(); ++n) {
      columns[0].push_back(loop.series.time[n]);
      for (int a = 0; a < 3; ++a) {
        columns[1 + a].push_back(loop.series.intended[n][a]);
        columns[4 + a].push_back(loop.series.position[n][a]);
        columns[7 + a].push_back(loop.series.force[n][a]);
      }
    }
    const std::string series = context.write_series(
        experiment, runs[i].name + "-loop",
        {"time_s", "intended_x_mm", "intended_y_mm", "intended_z_mm", "true_x_mm", "true_y_mm",
         "true_z_mm", "motor_force_x_N", "motor_force_y_N", "motor_force_z_N"},
        columns);
    plot.panels[i].curves.push_back(
        {runs[i].name, series, "motor_force_y_N", i == 0 ? "second" : "run"});
    plot.panels[2].curves.push_back({runs[i].name, series, "true_y_mm", i == 0 ? "second" : "run"});
    if (i == 1) plot.panels[2].curves.push_back({"intended", series, "intended_y_mm", "thin"});
  }
  figure.plots.push_back(plot);

  const ClosedLoopFigures &direct = loops[0].figures, &coupled = loops[1].figures;
  figure.claims.push_back(bound("Direct rendering vibrates", engine,
                                "RMS of the device's force above 20 Hz", "N", "the paper",
                                experiment.device.friction, direct.force_rms_above_20, true));
  figure.claims.push_back(
      bound("The coupling doesn't vibrate", engine, "RMS of the device's force above 20 Hz", "N",
            "below the device's friction", experiment.device.friction, coupled.force_rms_above_20));
  figure.claims.push_back(near("The coupling doesn't vibrate", engine, "samples that move backward",
                               "%", "the paper", 0, 100 * coupled.backward_fraction, 0.2, 100));
  figure.claims.push_back(bound(
      "Direct against coupled", engine, "RMS above 20 Hz, direct over coupled", "1",
      "the paper; ten is ours", 10, direct.force_rms_above_20 / coupled.force_rms_above_20, true));
  claim_known_points(figure, experiment, parameters);
  return figure;
}

}  // namespace toothprep::figures
