// Straight feed through a block (figures 9 to 13): every replay beside its exact integral.
#include <algorithm>
#include <cmath>
#include <optional>

#include "toothprep/proof/figures/figure_context.h"
#include "toothprep/proof/reference/closed_forms.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/grinding/engine.h"

namespace toothprep::figures {
namespace {

constexpr double kAim = 1;       // percent, of everything that the level-set engine is asked for
constexpr double kVoxelAim = 3;  // percent, of the voxel engine's plateaus
constexpr double kExact = 1e-3;  // percent, between an integral and its closed form
constexpr double kSettledAim = 1.5;  // percent, where the integral is still settling
// Of the plateau, RMS over the path: what the millisecond at which contact begins amounts to.
constexpr double kTimeStepPercent = 0.1;
constexpr double kAreaAim = 5;  // percent: grazing surface counts or not

// One variant: an engine at a voxel size.
struct Variant {
  EngineKind engine;
  double voxel;
  bool main;  // at the voxel size asked for
  std::optional<Outcome> outcome;
  std::optional<RunReport> report;
};

std::string lower(Tissue tissue) {
  return std::string(kTissueNames[static_cast<std::size_t>(tissue_index(tissue))]);
}

double aim(EngineKind engine) { return engine == EngineKind::kLevelset ? kAim : kVoxelAim; }

// The closed form of a whole cylinder or ball in one tissue, if the bur is one.
std::optional<reference::SteadyLoad> closed_form(const Run& run, const Bur& bur,
                                                 const Parameters& p, Tissue tissue, double speed) {
  const GrindingProperties& t = p.tissue[static_cast<std::size_t>(tissue_index(tissue))];
  const reference::Grinding g{t.specific_energy, t.force_ratio, p.handpiece.rotation_rate};
  if (t.specific_energy <= 0) return {};
  if (run.bur.rfind("cylinder:", 0) == 0)
    return cylinder_side_feed(g, bur.max_radius(), bur.head_length(), speed);
  if (run.bur.rfind("ball:", 0) == 0) return ball_side_feed(g, bur.max_radius(), speed);
  return {};
}

// How much there is of a vector against and across the feed.
struct Components {
  double against, across;
};
Components components(const Vec3& force, const Vec3& feed) {
  const Vec3 against = -feed.normalized();
  return {force.dot(against), (force - force.dot(against) * against).norm()};
}

void claim_plateaus(FigureReport& figure, const Run& run, const Bur& bur,
                    const std::vector<HandleSample>& path, const Parameters& parameters,
                    const Exact& exact, const std::vector<Variant>& variants) {
  const bool coupled = run.drive == Drive::kCoupled;
  const std::vector<Stretch> stretches = plateaus(exact);
  for (const Stretch& s : stretches) {
    const std::string tissue = lower(s.tissue);
    const Vec3 way = path[s.last].pose.position - path[s.first].pose.position;
    const double speed = way.norm() / (path[s.last].time - path[s.first].time);
    const Level expected = level(exact, s);
    const Components e = components(expected.force, way);
    if (const auto form = closed_form(run, bur, parameters, s.tissue, speed)) {
      const double allowed = coupled ? kSettledAim : kExact;
      const std::string agrees = coupled ? "The exact answer has settled near the closed form"
                                         : "The integral is the closed form";
      figure.claims.push_back(near(agrees, "", "force against the feed, " + tissue, "N",
                                   "closed form", form->against, e.against, allowed));
      figure.claims.push_back(near(agrees, "", "T_z, " + tissue, "mN·m", "closed form",
                                   form->torque, expected.torque, allowed));
    }
    for (const Variant& v : variants) {
      if (!v.main) continue;
      const Level l = level(*v.outcome, s);
      const Components m = components(l.force, way);
      const std::string what = "Level in " + tissue;
      const std::string engine = name_of(v.engine);
      figure.claims.push_back(near(what, engine, "force against the feed", "N", "exact integral",
                                   e.against, m.against, aim(v.engine)));
      figure.claims.push_back(near(what, engine, "force across the feed", "N", "exact integral",
                                   e.across, m.across, aim(v.engine)));
      figure.claims.push_back(near(what, engine, "T_z", "mN·m", "exact integral", expected.torque,
                                   l.torque, aim(v.engine)));
    }
  }
  // Dentin against enamel: the ratio of the specific energies.
  if (stretches.size() == 2 && parameters.tissue[0].specific_energy > 0 &&
      parameters.tissue[0].force_ratio == parameters.tissue[1].force_ratio) {
    // Coupled, the force in dentin is still settling at the end.
    const double ratio =
        coupled ? level(exact, stretches[1]).force.norm() / level(exact, stretches[0]).force.norm()
                : parameters.tissue[1].specific_energy / parameters.tissue[0].specific_energy;
    for (const Variant& v : variants)
      if (v.main)
        figure.claims.push_back(near("Smaller in dentin by the ratio of u", name_of(v.engine),
                                     "|F| dentin / enamel", "1",
                                     coupled ? "exact integral" : "closed form", ratio,
                                     level(*v.outcome, stretches[1]).force.norm() /
                                         level(*v.outcome, stretches[0]).force.norm(),
                                     aim(v.engine)));
  }
}

// Fits F = k x over rows with x > 0 and says how far from proportional the rows are.
struct Proportion {
  double factor, worst;  // worst |F - k x| in percent of the largest |F|
};
Proportion proportion(const std::vector<double>& x, const std::vector<double>& f) {
  double xx = 0, xf = 0, most = 0, worst = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    xx += x[i] * x[i];
    xf += x[i] * f[i];
    most = std::max(most, std::abs(f[i]));
  }
  const double factor = xx > 0 ? xf / xx : 0;
  for (std::size_t i = 0; i < x.size(); ++i)
    worst = std::max(worst, std::abs(f[i] - factor * x[i]));
  return {factor, most > 0 ? 100 * worst / most : 0};
}

// F_x, F_y and T_z in proportion to the speed (where the bur is fully engaged), or to the area of
// contact (from the moment on at which it was largest).
void claim_proportions(FigureReport& figure, bool to_speed, const Exact& exact,
                       const std::vector<Variant>& variants) {
  std::size_t first = 0, last = 0;
  const auto area = [](const PerTissue<double>& a) { return a[0] + a[1]; };
  if (to_speed) {
    const std::vector<Stretch> stretches = fully_engaged(exact);
    if (stretches.empty()) throw Error("the bur is never fully engaged");
    first = stretches[0].first;
    last = stretches[0].last;
  } else {
    double most = 0;
    for (const auto& a : exact.area) most = std::max(most, area(a));
    for (std::size_t i = 0; i < exact.area.size(); ++i) {
      if (area(exact.area[i]) >= (1 - 1e-6) * most) first = i;
      if (area(exact.area[i]) > 0) last = i;
    }
  }
  // The contact area is the exact one; what the engines report as area counts surface that only
  // grazes the walls, which takes no force, and is compared apart.
  const std::string by = to_speed ? "speed" : "contact area";
  struct Quantity {
    const char *name, *unit;
  };
  const Quantity quantities[3] = {{"F_x", to_speed ? "N·s/mm" : "N/mm²"},
                                  {"F_y", to_speed ? "N·s/mm" : "N/mm²"},
                                  {"T_z", to_speed ? "N·s" : "N/mm"}};
  for (const Variant& v : variants) {
    if (!v.main) continue;
    const std::vector<StepRecord>& rows = v.outcome->replay.rows;
    for (int q = 0; q < 3; ++q) {
      std::vector<double> x, measured, expected;
      for (std::size_t i = first; i <= last; ++i) {
        const double speed = rows[i].bur_velocity.norm();
        x.push_back(to_speed ? speed : area(exact.area[i]));
        measured.push_back(q < 2 ? rows[i].grinding_force[q] : rows[i].torque);
        expected.push_back(q < 2 ? exact.force[i][q] : exact.torque[i]);
      }
      const Proportion m = proportion(x, measured), e = proportion(x, expected);
      figure.claims.push_back(near("In proportion to the " + by, name_of(v.engine),
                                   std::string(quantities[q].name) + " / " + by, quantities[q].unit,
                                   "exact integral", e.factor, m.factor, aim(v.engine)));
      // The voxel engine's contact changes by whole voxels.
      const double resolution = 100 * v.voxel / 2.5;
      figure.claims.push_back(
          bound("In proportion to the " + by, name_of(v.engine),
                std::string(quantities[q].name) + ", largest deviation from proportional", "%",
                v.engine == EngineKind::kLevelset ? "aim" : "one voxel of 2.5 mm, and 3 %",
                v.engine == EngineKind::kLevelset ? kAim : kVoxelAim + (to_speed ? 0 : resolution),
                m.worst));
    }
  }
}

// The reported area of contact against the exact one, over the rows in which it is whole or
// shrinks.
void claim_area(FigureReport& figure, const Exact& exact, const std::vector<Variant>& variants) {
  double most = 0, worst = 0;
  for (const auto& a : exact.area) most = std::max(most, a[0] + a[1]);
  for (const Variant& v : variants) {
    if (!v.main || v.engine != EngineKind::kLevelset) continue;
    for (std::size_t i = 0; i < exact.area.size(); ++i) {
      const PerTissue<double>& a = v.outcome->replay.rows[i].contact_area;
      worst = std::max(worst, std::abs(a[0] + a[1] - exact.area[i][0] - exact.area[i][1]) / most);
    }
    figure.claims.push_back(bound("The area of contact is reported", name_of(v.engine),
                                  "largest deviation, of the largest area", "%", "exact integral",
                                  kAreaAim, 100 * worst));
  }
}

void claim_accuracy(FigureReport& figure, const Run& run, const std::vector<Variant>& variants) {
  const RunReport* main[2] = {nullptr, nullptr};
  for (const Variant& v : variants)
    if (v.main) main[v.engine == EngineKind::kVoxel] = &*v.report;
  if (const RunReport* r = main[0]) {
    const bool coupled = run.drive == Drive::kCoupled;
    figure.claims.push_back(bound("The whole path is the exact integral", "levelset",
                                  "RMS deviation of the force", "%", "aim", kAim,
                                  r->force_rms_percent));
    if (coupled)
      figure.claims.push_back(bound("The rise is that of spring and tissue", "levelset",
                                    "largest deviation of the force anywhere", "%", "aim", kAim,
                                    r->force_max_percent));
    figure.claims.push_back(near("Work of the torque = energy of what was removed", "levelset",
                                 "energy ratio", "1", "invariant", 1, r->energy_ratio, kAuditAim));
    std::vector<double> rms;  // from coarse to fine
    for (const Variant& v : variants)
      if (v.engine == EngineKind::kLevelset && v.report) rms.push_back(v.report->force_rms_percent);
    if (rms.size() == 3)
      figure.claims.push_back(bound("The deviation falls with the voxel", "levelset",
                                    "RMS of the force at half the voxel and element: that at twice "
                                    "both, or that of a time step",
                                    "%", "convergence", std::max(rms[0], kTimeStepPercent),
                                    rms[2]));
  }
  if (main[0] && main[1] && main[0]->has_plateau && main[1]->voxel_effect_percent > 0.01 &&
      run.drive == Drive::kDirect)
    figure.claims.push_back(bound("The level-set engine has less voxel effect", "levelset",
                                  "RMS deviation of the force on the plateaus", "%",
                                  "the voxel engine's", main[1]->voxel_effect_percent,
                                  main[0]->voxel_effect_percent));
}

}  // namespace

FigureReport feed_figure(const Experiment& experiment, FigureContext& context) {
  const FigureOptions& o = context.options();
  FigureReport figure;
  for (const Run& run : experiment.runs) {
    const Parameters parameters = parameters_of(run, o.base);
    const Bur bur = make_bur(run.bur, o.bur_library);
    const std::vector<HandleSample> path = context.path(run, parameters);
    const Exact exact = exact_answer(run, parameters, path, o.bur_library);

    std::vector<Variant> variants;
    for (const EngineKind engine : o.engines)
      for (const double voxel : {2 * o.voxel, o.voxel, o.voxel / 2})
        variants.push_back({engine, voxel, voxel == o.voxel, {}, {}});
    std::vector<FigureContext::Job> jobs;
    // The finest first, so that the last to be done are short.
    std::vector<Variant*> order;
    for (Variant& v : variants) order.push_back(&v);
    std::stable_sort(order.begin(), order.end(),
                     [](const Variant* a, const Variant* b) { return a->voxel < b->voxel; });
    for (Variant* variant : order)
      jobs.push_back({experiment.name, [&, variant] {
                        Parameters p = parameters;
                        p.engine = variant->engine;
                        if (p.engine != EngineKind::kVoxel) p.trailing_elements = false;
                        try {
                          p.element_size = element_size(bur, p) * variant->voxel / o.voxel;
                          Outcome outcome = run_on(
                              run, p, path, context.specimen(experiment, run, variant->voxel),
                              o.bur_library);
                          variant->report = report_of(run, outcome, variant->voxel, &exact);
                          if (variant->main) variant->outcome = std::move(outcome);
                        } catch (const Error&) {
                          // Twice the voxel may be too coarse for the bur: that row is left out.
                          if (variant->voxel <= o.voxel) throw;
                        }
                      }});
    context.run(jobs);

    const std::string prefix = experiment.runs.size() > 1 ? run.name + "-" : "";
    const std::string exact_file = context.write_exact(experiment, prefix + "exact", path, exact);
    std::vector<Curve> curves;
    for (Variant& v : variants) {
      if (!v.report) continue;
      if (v.main) {
        const std::string name = prefix + name_of(v.engine);
        const std::string label = v.engine == EngineKind::kLevelset ? "level sets" : "voxels";
        v.report->trace = context.write_trace(experiment, name, run, *v.outcome);
        v.report->exact = exact_file;
        curves.push_back(
            {label, v.report->trace, "", v.engine == EngineKind::kLevelset ? "run" : "second"});
        auto [mesh, surface] = context.write_surface(experiment, name, v.outcome->prepared);
        figure.pictures.push_back(block_picture(
            experiment.name + "/" + name + ".png",
            experiment.title + (prefix.empty() ? "" : ", " + run.title) + ": the block, " + label,
            mesh));
        figure.surfaces.emplace(std::move(mesh), std::move(surface));
      }
      figure.runs.push_back(*v.report);
    }
    // The voxel engine's curve lies beneath.
    std::reverse(curves.begin(), curves.end());
    Plot plot;
    plot.file = experiment.name + "/" + prefix + "forces";
    plot.title = experiment.title;
    plot.panels = force_panels(curves, exact_file);
    plot.tissues = exact_file;
    figure.plots.push_back(plot);

    if (experiment.kind == Kind::kPlateaus)
      claim_plateaus(figure, run, bur, path, parameters, exact, variants);
    else
      claim_proportions(figure, experiment.kind == Kind::kProportionalToSpeed, exact, variants);
    if (experiment.kind == Kind::kProportionalToArea) claim_area(figure, exact, variants);
    claim_accuracy(figure, run, variants);
  }
  return figure;
}

}  // namespace toothprep::figures
