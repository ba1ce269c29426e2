// What the coupling hides of a tooth, what it keeps stable, and what rings, on several devices.
//
// For each device: the stiffness that theory, practice and the simulated loop allow; how far the bur
// lags; a damper that ends the ringing of a bur in free air whatever the time step, and the noise of
// the encoder's counts that it adds; and what the hand feels above 20 Hz of a cut over (k, b).
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

#include "toothprep/proof/figures/coupled_cut.h"
#include "toothprep/proof/figures/figure_context.h"
#include "toothprep/proof/reference/coupling_response.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/session/implicit_step.h"
#include "toothprep/tools/device/linear_damper_loop.h"
#include "toothprep/tools/device/stability_map.h"

namespace toothprep::figures {
namespace {

constexpr double kToPerMetre = 1e3;   // N·s/mm to N·s/m
constexpr double kRounding = 1e-6;    // percent: rounding
constexpr double kNoiseAim = 2;       // percent: a whole number of counts in 4 s
constexpr double kCutAim = 1;         // percent, of a simulated cut from its closed form
constexpr double kForceAim = 2;       // percent: the handle's speed in the hand
constexpr double kTransferAim = 1;    // percent
constexpr double kTightShare = 0.02;  // of the release, beside the asked
constexpr double kFirstStiffness = 0.2, kMostStiffness = 60;  // N/mm, of the search
constexpr double kStiffnessRatio = 1.1;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// What all parts need.
struct Setting {
  const Transparency& asked;
  HandModel hand;
  CoupledCut cut;  // in dentin, with the run's parameters

  double step() const { return cut.parameters.time_step; }
  double mass() const { return cut.parameters.coupling.bur_mass; }
  CoupledCut with(Tissue tissue, double stiffness, double damping) const {
    CoupledCut c = cut;
    c.tissue = tissue;
    c.parameters.coupling.stiffness = stiffness;
    c.parameters.coupling.damping = damping;
    return c;
  }
  // Against the feed, N at `speed` mm/s.
  double force(Tissue tissue, double speed) const {
    CoupledCut c = cut;
    c.tissue = tissue;
    return reference::cylinder_side_feed(grinding_of(c), c.radius, c.length, speed).against;
  }
  double resistance() const { return force(Tissue::kEnamel, 1); }  // in enamel
};

const char* name_of_tissue(Tissue t) { return t == Tissue::kEnamel ? "enamel" : "dentin"; }

std::string rounded(double x) {
  std::string text = std::to_string(std::round(100 * x) / 100);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

// Of a release from rest at 1 mm, by the session's own integrator: the largest from `time` on.
double stepped_remaining(const reference::BurOnCoupling& c, double time) {
  Coupling coupling;
  coupling.bur_mass = c.mass;
  coupling.stiffness = c.stiffness;
  coupling.damping = c.damping;
  CouplingState s{Vec3::UnitX(), Vec3::Zero(), Vec3::Zero(), Vec3::Zero()};
  const double h = c.time_step;
  double most = 0;
  for (int n = 1; n * h < 5 * time; ++n) {
    s.velocity = implicit_velocity(coupling, h, s, Mat3::Zero(), Vec3::Zero());
    s.position += h * s.velocity;
    if (n >= std::lround(time / h)) most = std::max(most, std::abs(s.position.x()));
  }
  return most;
}

// ---- Ringing

void add_ringing(FigureReport& figure, const Setting& s) {
  const Transparency& t = s.asked;
  std::vector<double> steps = t.time_steps;
  steps.push_back(0);
  const std::string after = rounded(1e3 * t.settled_time) + " ms";
  MetricTable table;
  table.title = "Ringing in free air: the largest swing from " + after + " on, % of the release";
  table.columns = {"k N/mm", "frequency Hz", "b N·s/m"};
  for (const double h : steps)
    table.columns.push_back(h > 0 ? "h = " + rounded(1e3 * h) + " ms" : "h to 0");
  table.columns.push_back("least b for " + rounded(100 * t.settled_share) + " % N·s/m");
  table.columns.push_back("least b for " + rounded(100 * kTightShare) + " % N·s/m");
  for (const RenderingDevice& d : t.devices) {
    const double k = d.practical_stiffness;
    for (const double b : {0.0, d.recommended_damping}) {
      std::vector<double> row = {k, reference::free_air_frequency({s.mass(), k, 0, 0}),
                                 kToPerMetre * b};
      for (const double h : steps) {
        const reference::BurOnCoupling c{s.mass(), k, b, h};
        const double exact = 100 * reference::remaining(c, t.settled_time);
        row.push_back(exact);
        const std::string at = h > 0 ? "h = " + rounded(1e3 * h) + " ms" : "the limit of h";
        const double stepped = h > 0 ? 100 * stepped_remaining(c, t.settled_time) : exact;
        if (h > 0)
          figure.claims.push_back(near("Ringing follows the roots of the step: " + d.title, "",
                                       "largest swing from " + after +
                                           " on, b = " + rounded(kToPerMetre * b) + " N·s/m, " + at,
                                       "%", "closed form", exact, stepped, kRounding, 100));
        if (b > 0)
          figure.claims.push_back(bound("The recommended damper ends the ringing: " + d.title, "",
                                        "largest swing from " + after + " on, " + at, "%",
                                        "the threshold is ours", 100 * t.settled_share, stepped));
      }
      for (const double share : {t.settled_share, kTightShare})
        row.push_back(kToPerMetre *
                      reference::least_damping(s.mass(), k, steps, t.settled_time, share));
      table.rows.push_back({d.name, d.title, row});
    }
  }
  figure.tables.push_back(table);
}

// ---- Encoder noise of a damper

// The coupled force of a handle read in counts that moves at `speed`, less that without damper.
std::vector<double> noise_of(const Setting& s, const RenderingDevice& d, double speed) {
  const double h = s.step(), count = d.model.encoder_count;
  Coupling with = s.cut.parameters.coupling, without;
  with.stiffness = d.practical_stiffness;
  without = with;
  with.damping = d.recommended_damping;
  without.damping = 0;
  LinearDamper damped(Rendering::kCoupled, s.resistance(), h, with, Vec3::Zero());
  LinearDamper plain(Rendering::kCoupled, s.resistance(), h, without, Vec3::Zero());
  std::vector<double> noise;
  for (std::size_t n = 1; static_cast<double>(n) * h < 4; ++n) {
    const double x = speed * static_cast<double>(n) * h;
    const Vec3 reading(count * std::floor(x / count + 0.5), 0, 0);
    noise.push_back(damped(n, reading).x() - plain(n, reading).x());
  }
  return noise;
}

void add_noise(FigureReport& figure, const Setting& s) {
  const Transparency& t = s.asked;
  const double h = s.step(), speed = t.feeds.front();
  MetricTable table;
  table.title = "Noise of the encoder's counts that the recommended damper adds, at " +
                rounded(1e3 * h) + " ms";
  table.columns = {"count mm",
                   "b N·s/m",
                   "a count, bur held N",
                   "a count, in the air N",
                   "RMS N",
                   "spring alone: a count N",
                   "friction N"};
  for (const RenderingDevice& d : t.devices) {
    const double D = d.model.encoder_count, b = d.recommended_damping, k = d.practical_stiffness;
    const double peak = b * D / h, share = std::min(1.0, speed * h / D);
    const double rms = peak * std::sqrt(share * (1 - share));
    const double inertia = s.mass() / h;
    const double air = inertia * (k + b / h) * D / (inertia + h * k + b);
    table.rows.push_back(
        {d.name, d.title, {D, kToPerMetre * b, peak, air, rms, k * D, d.model.friction}});
    if (b == 0) continue;
    const std::vector<double> noise = noise_of(s, d, speed);
    double mean = 0, sum = 0, most = 0;
    for (const double x : noise) mean += x / static_cast<double>(noise.size());
    for (const double x : noise) {
      sum += (x - mean) * (x - mean);
      most = std::max(most, std::abs(x));
    }
    const std::string claim = "A damper multiplies the counts: " + d.title;
    figure.claims.push_back(near(claim, "", "force of a count, bur held in enamel", "N",
                                 "closed form b D/h", peak, most, kNoiseAim));
    figure.claims.push_back(near(claim, "", "RMS while the handle feeds", "N",
                                 "closed form b D/h sqrt(p (1 - p)), p = v h/D", rms,
                                 std::sqrt(sum / static_cast<double>(noise.size())), kNoiseAim));
    Coupling c = s.cut.parameters.coupling;
    c.stiffness = k;
    c.damping = b;
    LinearDamper in_air(Rendering::kCoupled, 0, h, c, Vec3::Zero());
    figure.claims.push_back(near(claim, "", "force of a count, bur in the air", "N", "closed form",
                                 air, in_air(1, Vec3(D, 0, 0)).norm(), kRounding));
    figure.claims.push_back(bound("The noise of the recommended damper isn't felt: " + d.title, "",
                                  "RMS while the handle feeds", "N", "the threshold is ours",
                                  t.felt, rms));
  }
  figure.tables.push_back(table);
}

// ---- Largest stiffness

// The last before the first stiffness at which the simulated device isn't stable while the hand
// pulls a bur that enamel holds, N/mm; NaN: not even the first.
double largest_stable(const Setting& s, const RenderingDevice& d, double damping) {
  LinearDamperExperiment e;
  e.phantom = d.model;
  e.phantom.rate = 1 / s.step();
  e.hand = s.hand;
  e.rendering = Rendering::kCoupled;
  e.damping = s.resistance();
  e.coupling = s.cut.parameters.coupling;
  e.coupling.damping = damping;
  e.speed = s.asked.feeds.front();
  if (s.hand.stiffness > 0) {  // the time in which the hand's spring overcomes the friction
    const double stuck = d.model.friction / (s.hand.stiffness * e.speed);
    e.settling += stuck;
    e.duration += stuck;
  }
  double last = kNan;
  for (double k = kFirstStiffness; k <= kMostStiffness; k *= kStiffnessRatio) {
    e.coupling.stiffness = k;
    if (run_linear_damper(e).figures.verdict != LoopVerdict::kStable) break;
    last = k;
  }
  return last;
}

void add_stiffness(FigureReport& figure, const Setting& s) {
  const Transparency& t = s.asked;
  const double h = s.step();
  std::vector<std::array<double, 2>> stable(t.devices.size());
  tbb::parallel_for(std::size_t{0}, 2 * t.devices.size(), [&](std::size_t i) {
    const RenderingDevice& d = t.devices[i / 2];
    stable[i / 2][i % 2] = largest_stable(s, d, i % 2 == 0 ? 0 : d.recommended_damping);
  });
  MetricTable table;
  table.title = "The largest stiffness, N/mm, and limits of the damper, N·s/m";
  table.columns = {"in practice k",
                   "passive in any hand, b = 0: 2 b_d/T",
                   "with the hand's damping, b = 0",
                   "counts against friction: 2 f_c/D",
                   "simulated loop, b = 0",
                   "simulated loop, b recommended",
                   "b: counts against friction 2 f_c T/D"};
  for (std::size_t i = 0; i < t.devices.size(); ++i) {
    const RenderingDevice& d = t.devices[i];
    const PhantomModel& m = d.model;
    const double whole = m.damping + s.hand.damping, k = d.practical_stiffness;
    const double b = d.recommended_damping;
    table.rows.push_back(
        {d.name,
         d.title,
         {k, coupling_stiffness_limit(m.damping, h), coupling_stiffness_limit(whole, h),
          friction_stiffness_limit(m.friction, m.encoder_count), stable[i][0], stable[i][1],
          kToPerMetre * friction_damping_limit(m.friction, h, m.encoder_count)}});
    const std::string practice = "The stiffness in practice is stable: " + d.title;
    for (const int with : {0, 1})
      figure.claims.push_back(bound(practice, "",
                                    std::string("largest stable k of the simulated loop, b ") +
                                        (with ? "recommended" : "= 0"),
                                    "N/mm", "public practice", k,
                                    stable[i][static_cast<std::size_t>(with)], true));
    const std::string passive = "Passive by Colgate and Schenkel, b_d > k T/2 + b: " + d.title;
    for (const double used : {0.0, b}) {
      const double need = kToPerMetre * (k * h / 2 + used);
      const std::string what = "k T/2 + b, b = " + rounded(kToPerMetre * used) + " N·s/m";
      figure.claims.push_back(bound(passive, "", what + ", in any hand", "N·s/m",
                                    "the arm's damping", kToPerMetre * m.damping, need));
      figure.claims.push_back(bound(passive, "", what + ", in this hand", "N·s/m",
                                    "the arm's and the hand's damping", kToPerMetre * whole, need));
    }
    figure.claims.push_back(bound("A count doesn't overcome the friction: " + d.title, "",
                                  "(k + b/T) D, recommended b", "N", "2 f_c", 2 * m.friction,
                                  (k + b / h) * m.encoder_count));
  }
  figure.tables.push_back(table);
}

// ---- Lag, and what of the tissue reaches the hand

void add_lag(FigureReport& figure, const Setting& s, const std::string& engine) {
  const Transparency& t = s.asked;
  MetricTable table;
  table.title = "Lag of the bur behind the handle in a steady slot, F/k";
  table.columns = {"feed mm/s", "force N"};
  for (const RenderingDevice& d : t.devices) {
    table.columns.push_back(d.name + ": lag mm");
    table.columns.push_back(d.name + ": of its force %");
    table.columns.push_back(d.name + ": 63 % after s, B/k");
  }
  const double k = t.devices.front().practical_stiffness;
  for (const Tissue tissue : {Tissue::kEnamel, Tissue::kDentin})
    for (const double feed : t.feeds) {
      const SteadyFeed cut = steady_feed(s.with(tissue, k, 0), feed, 0.3);
      const double force = k * cut.expected.norm();
      std::vector<double> row = {feed, force};
      for (const RenderingDevice& d : t.devices) {
        row.push_back(force / d.practical_stiffness);
        row.push_back(100 * force / d.model.force_limit);
        row.push_back(s.force(tissue, 1) / d.practical_stiffness);
      }
      const std::string where =
          std::string(name_of_tissue(tissue)) + ", " + rounded(feed) + " mm/s";
      table.rows.push_back({std::string(name_of_tissue(tissue)) + "-" + rounded(feed), where, row});
      const std::string claim = "A bur that lags by F/k goes as fast as the handle: " + where;
      figure.claims.push_back(
          near(claim, engine, "speed of the bur, off the handle's", "%", "closed form", 0,
               100 * (cut.speed - Vec3(0, -feed, 0)).norm() / feed, kCutAim, 100));
      figure.claims.push_back(near(claim, engine, "lag", "mm", "closed form F/k",
                                   cut.expected.norm(), cut.lag.norm(), kCutAim));
    }
  figure.tables.push_back(table);
}

void add_transfer(FigureReport& figure, const Setting& s, const std::string& engine) {
  const Transparency& t = s.asked;
  const double b_max = t.devices.front().recommended_damping, feed = t.feeds.front();
  struct Row {
    double k, b;
    std::vector<double> force;
  };
  std::vector<Row> rows;
  for (const double b : {0.0, b_max})
    for (const double k : t.stiffnesses) rows.push_back({k, b, {}});
  const std::vector<double> direct = plunge(s.cut, Drive::kDirect, feed, t.frequencies);
  tbb::parallel_for(std::size_t{0}, rows.size(), [&](std::size_t i) {
    rows[i].force =
        plunge(s.with(Tissue::kDentin, rows[i].k, rows[i].b), Drive::kCoupled, feed, t.frequencies);
  });
  MetricTable table;
  table.title =
      "What reaches the hand of a resistance that direct drive would give, %: plunge in "
      "dentin, measured and closed form";
  table.columns = {"k N/mm", "b N·s/m"};
  for (const double f : t.frequencies) {
    table.columns.push_back(rounded(f) + " Hz");
    table.columns.push_back("exact");
  }
  const double B =
      reference::flat_end_plunge(grinding_of(s.cut), s.cut.radius, 1).against;  // dentin's
  for (const Row& r : rows) {
    std::vector<double> values = {r.k, kToPerMetre * r.b};
    double off = 0;
    for (std::size_t i = 0; i < t.frequencies.size(); ++i) {
      const double exact =
          std::abs(reference::rendered_share({s.mass(), r.k, r.b, s.step()}, B, t.frequencies[i]));
      const double share = r.force[i] / direct[i];
      values.push_back(100 * share);
      values.push_back(100 * exact);
      off = std::max(off, 100 * std::abs(share / exact - 1));
    }
    const std::string title =
        "k = " + rounded(r.k) + " N/mm, b = " + rounded(kToPerMetre * r.b) + " N·s/m";
    table.rows.push_back({"k" + rounded(r.k) + "-b" + rounded(kToPerMetre * r.b), title, values});
    figure.claims.push_back(near("The coupling is a low-pass of the tissue: " + title, engine,
                                 "largest difference from the closed form", "%", "closed form", 0,
                                 off, kTransferAim, 100));
  }
  figure.tables.push_back(table);
}

// ---- The closed loop over (k, b)

struct LoopCell {
  double k = 0, b = 0;
  Tissue tissue = Tissue::kEnamel;
  Drive drive = Drive::kCoupled;
  LoopCut cut;
};

// `enamel`, `dentin`: their loop_block().
std::vector<LoopCell> loop_cells(const Setting& s, const RenderingDevice& d,
                                 const LayeredTooth& enamel, const LayeredTooth& dentin) {
  const Transparency& t = s.asked;
  std::vector<double> dampings = {0};
  dampings.insert(dampings.end(), t.dampings.begin(), t.dampings.end());
  std::vector<LoopCell> cells;
  for (const Tissue tissue : {Tissue::kEnamel, Tissue::kDentin}) {
    for (const double k : t.stiffnesses)
      for (const double b : dampings) cells.push_back({k, b, tissue, Drive::kCoupled, {}});
    if (!std::count(t.stiffnesses.begin(), t.stiffnesses.end(), d.practical_stiffness) ||
        !std::count(dampings.begin(), dampings.end(), d.recommended_damping))
      cells.push_back({d.practical_stiffness, d.recommended_damping, tissue, Drive::kCoupled, {}});
    cells.push_back({0, 0, tissue, Drive::kDirect, {}});
  }
  tbb::parallel_for(std::size_t{0}, cells.size(), [&](std::size_t i) {
    LoopCell& c = cells[i];
    const bool direct = c.drive == Drive::kDirect;
    c.cut = loop_cut(s.with(c.tissue, direct ? d.practical_stiffness : c.k, c.b),
                     c.tissue == Tissue::kEnamel ? enamel : dentin, c.drive, d.model, s.hand,
                     t.feeds.front());
  });
  return cells;
}

const char* verdict_text(LoopVerdict v) {
  return v == LoopVerdict::kStable     ? "stable"
         : v == LoopVerdict::kVibrates ? "vibrates"
                                       : "unstable";
}

MapPlot loop_map(const Experiment& experiment, const Setting& s, const RenderingDevice& d,
                 const std::vector<LoopCell>& cells) {
  const Transparency& t = s.asked;
  MapPlot plot;
  plot.file = experiment.name + "/map-" + d.name;
  plot.title = d.title + ": what the hand feels above 20 Hz in enamel";
  plot.x_label = "damper of the coupling $b$ (N·s/m)";
  plot.y_label = "stiffness of the coupling $k$ (N/mm)";
  plot.most = 0.1;
  plot.value_label = "RMS of the force above 20 Hz (N)";
  plot.y = t.stiffnesses;
  for (const double b : t.dampings) plot.x.push_back(kToPerMetre * b);
  for (std::size_t row = 0; row < t.stiffnesses.size(); ++row) {
    plot.values.emplace_back();
    plot.verdicts.emplace_back();
    for (std::size_t i = 0; i < t.dampings.size(); ++i) {
      const LoopCell& c = cells[row * (t.dampings.size() + 1) + i + 1];  // b = 0 has no logarithm
      plot.values.back().push_back(c.cut.felt.force_rms_above_20);
      plot.verdicts.back().push_back(verdict_text(c.cut.felt.verdict));
    }
  }
  const double k = d.practical_stiffness, b = kToPerMetre * d.recommended_damping;
  const double most =
      kToPerMetre * friction_damping_limit(d.model.friction, s.step(), d.model.encoder_count);
  plot.lines = {{"$2 f_c T/D$", {most, most}, {plot.y.front(), plot.y.back()}},
                {"recommended $b$", {b, b}, {plot.y.front(), plot.y.back()}},
                {"$k$ in practice", {plot.x.front(), plot.x.back()}, {k, k}}};
  return plot;
}

void add_cuts(FigureReport& figure, FigureContext& context, const Experiment& experiment,
              const Setting& s, const RenderingDevice& d, const std::vector<LoopCell>& cells,
              const std::string& engine) {
  MetricTable table;
  table.title = "Cut at " + rounded(s.asked.feeds.front()) + " mm/s on the simulated " + d.title +
                " and hand";
  table.columns = {"k N/mm",
                   "b N·s/m",
                   "felt above 20 Hz N",
                   "at the bur above 20 Hz N",
                   "largest jump N",
                   "backward %",
                   "at the force limit %",
                   "force N",
                   "way of the handle mm"};
  std::vector<std::vector<double>> columns(table.columns.size() + 1);
  for (const LoopCell& c : cells) {
    const LoopCut& r = c.cut;
    const bool direct = c.drive == Drive::kDirect;
    const std::vector<double> values = {direct ? kNan : c.k,
                                        direct ? kNan : kToPerMetre * c.b,
                                        r.felt.force_rms_above_20,
                                        r.at_bur,
                                        r.jump,
                                        100 * r.felt.backward_fraction,
                                        100 * r.felt.saturated_fraction,
                                        r.force,
                                        r.way};
    const std::string tissue = name_of_tissue(c.tissue);
    if (direct || c.k == d.practical_stiffness)
      table.rows.push_back({d.name, direct ? tissue + ", direct" : tissue, values});
    if (!direct) {
      columns[0].push_back(c.tissue == Tissue::kEnamel ? 0 : 1);
      for (std::size_t i = 0; i < values.size(); ++i) columns[i + 1].push_back(values[i]);
    }
    if (c.k == d.practical_stiffness && c.b == d.recommended_damping) {
      const std::string claim = "The recommended coupling is quiet: " + d.title + ", " + tissue;
      figure.claims.push_back(bound(claim, engine, "RMS of the device's force above 20 Hz", "N",
                                    "the threshold is ours", s.asked.felt,
                                    r.felt.force_rms_above_20));
      figure.claims.push_back(near("The device renders the cut: " + d.title + ", " + tissue, engine,
                                   "force against the feed", "N", "closed form",
                                   s.force(c.tissue, s.asked.feeds.front()), r.force, kForceAim));
      figure.claims.push_back(near(claim, engine, "samples that move backward", "%",
                                   "what only resists", 0, 100 * r.felt.backward_fraction, 0.2,
                                   100));
    }
  }
  figure.tables.push_back(table);
  context.write_series(experiment, d.name,
                       {"dentin", "stiffness_n_per_mm", "damping_n_s_per_m", "felt_above_20_hz_N",
                        "at_bur_above_20_hz_N", "largest_jump_N", "backward_percent",
                        "at_force_limit_percent", "force_N", "way_mm"},
                       columns);
  figure.maps.push_back(loop_map(experiment, s, d, cells));
}

CoupledCut cut_of(const Experiment& experiment, const FigureOptions& o) {
  const Run& run = experiment.runs.front();
  if (run.bur.rfind("cylinder:", 0) != 0)
    throw Error(experiment.name + ": bur: must be a cylinder; give \"cylinder:D1.2xL3.0\"");
  const Bur bur = make_bur(run.bur, o.bur_library);
  CoupledCut cut;
  cut.radius = bur.max_radius();
  cut.length = bur.head_length();
  cut.parameters = parameters_of(run, o.base);
  cut.parameters.engine = EngineKind::kLevelset;
  cut.voxel = o.voxel;
  return cut;
}

}  // namespace

FigureReport transparency_figure(const Experiment& experiment, FigureContext& context) {
  const Transparency& t = experiment.transparency;
  const Setting s{t, experiment.hand, cut_of(experiment, context.options())};
  const std::string engine = name_of(EngineKind::kLevelset);
  const LayeredTooth enamel = loop_block(s.with(Tissue::kEnamel, 1, 0), t.feeds.front()),
                     dentin = loop_block(s.with(Tissue::kDentin, 1, 0), t.feeds.front());
  FigureReport stiffness, cuts, figure;
  std::vector<std::vector<LoopCell>> cells(t.devices.size());
  std::vector<FigureContext::Job> jobs = {{experiment.name + ", stability",
                                           [&] {
                                             add_stiffness(stiffness, s);
                                             add_ringing(stiffness, s);
                                             add_noise(stiffness, s);
                                           }},
                                          {experiment.name + ", lag and transfer", [&] {
                                             add_lag(cuts, s, engine);
                                             add_transfer(cuts, s, engine);
                                           }}};
  for (std::size_t i = 0; i < t.devices.size(); ++i)
    jobs.push_back({experiment.name + ", " + t.devices[i].name,
                    [&, i] { cells[i] = loop_cells(s, t.devices[i], enamel, dentin); }});
  context.run(jobs);
  for (FigureReport* part : {&stiffness, &cuts}) {
    figure.tables.insert(figure.tables.end(), part->tables.begin(), part->tables.end());
    figure.claims.insert(figure.claims.end(), part->claims.begin(), part->claims.end());
  }
  for (std::size_t i = 0; i < t.devices.size(); ++i)
    add_cuts(figure, context, experiment, s, t.devices[i], cells[i], engine);
  return figure;
}

}  // namespace toothprep::figures
