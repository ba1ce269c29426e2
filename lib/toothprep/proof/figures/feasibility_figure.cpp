// Figure 13 as the paper set it up, beside the direct curve of the same parameters, and a map of
// what agrees with all that the paper states about one bur in enamel.
//
// The paper gives neither N, nor k, nor how much of the bur is engaged. For a cylinder of radius R,
// of which a length L is engaged, closed_forms.h gives
//
//   stall speed             v_s = pi tau_s N / (u R L)          in enamel
//   resistance to the feed  B   = u L / (4 alpha N)             in each tissue
//
// both of N/L alone, and B v_s = pi tau_s / (4 alpha R) of neither. How far a coupled bur comes
// towards the plateau before it leaves the enamel depends, for a given feed and thickness, on k/B
// alone. So the map over (N, k, L) is one over (N/L, k), drawn once for each L.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>
#include <unordered_map>

#include "toothprep/proof/figures/figure_context.h"
#include "toothprep/proof/reference/closed_forms.h"
#include "toothprep/proof/reference/rise_in_layer.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/device/stability_map.h"

namespace toothprep::figures {
namespace {

constexpr double kReplayAim = 1;  // percent, between a replay and its exact answer
constexpr double kApart = 10;     // percent of the plateau: ours, for "differs"
constexpr double kPractice = 1;   // N/mm: what a Phantom Desktop renders stably in public practice

// The coupled curve beside the direct one.
struct Difference {
  double peak = 0;   // percent of the plateau: the largest force before dentin is met
  double apart = 0;  // percent of the time in contact with more than kApart between them
};

double area_of(const PerTissue<double>& area) { return area[0] + area[1] + area[2] + area[3]; }

Difference difference(const std::vector<Vec3>& coupled, const Exact& timing, const Exact& direct) {
  double plateau = 0, peak = 0;
  for (std::size_t i = 0; i < direct.force.size(); ++i) {
    if (direct.area[i][1] == 0) plateau = std::max(plateau, direct.force[i].norm());
    if (timing.area[i][1] == 0 && timing.area[i][0] > 0) peak = std::max(peak, coupled[i].norm());
  }
  Difference d;
  if (plateau == 0) return d;
  d.peak = 100 * peak / plateau;
  std::size_t met = 0, apart = 0;
  for (std::size_t i = 0; i < direct.force.size(); ++i) {
    if (area_of(direct.area[i]) == 0) continue;
    ++met;
    apart += 100 * (coupled[i] - direct.force[i]).norm() > kApart * plateau;
  }
  d.apart = 100 * static_cast<double>(apart) / static_cast<double>(met);
  return d;
}

// A run: the replay, its exact curve, and the exact curve of direct drive along the same path.
struct Beside {
  Outcome outcome;
  std::vector<HandleSample> path;
  Exact coupled, direct;
};

// The stall speed that a run's torque means, mm/s: torque is in proportion to the speed.
double stall_speed_of(const Beside& b, double stall_torque) {
  double sum = 0;
  std::size_t rows = 0;
  double most = 0;
  for (const auto& area : b.coupled.area) most = std::max(most, area[0]);
  for (std::size_t i = 0; i < b.coupled.area.size(); ++i) {
    if (b.coupled.area[i][0] < (1 - 1e-6) * most || b.coupled.area[i][1] > 0) continue;
    const StepRecord& row = b.outcome.replay.rows[i];
    sum += stall_torque * row.bur_velocity.norm() / row.torque;
    ++rows;
  }
  return rows > 0 ? sum / static_cast<double>(rows) : std::nan("");
}

// What the map asks of one point, and what is there.
class Statements {
 public:
  Statements(const Experiment& experiment, const Run& run, const Parameters& parameters,
             const std::string& bur_library, double speed)
      : asked_(experiment.feasibility),
        parameters_(parameters),
        bur_(make_bur(run.bur, bur_library)),
        scene_(reference::make_scene(bur_, {run.block.size, run.block.enamel}, parameters)),
        depth_(run.block.enamel),
        speed_(speed) {
    const double damping = experiment.device.damping + experiment.hand.damping;
    damping_limit_ = coupling_stiffness_limit(damping, parameters.time_step);
    if (experiment.device.encoder_count > 0)
      friction_limit_ =
          friction_stiffness_limit(experiment.device.friction, experiment.device.encoder_count);
    whole_ = resistance(0, scene_.rotation_rate, bur_.head_length());
    double low = kLeastRatio * whole_, high = kMostRatio * whole_;
    while (high > 1.0005 * low) {
      const double middle = std::sqrt(low * high);
      (peak_of_whole(middle) >= asked_.peak_percent ? high : low) = middle;
    }
    least_of_whole_ = high;
  }

  reference::Grinding grinding(int tissue, double rate) const {
    const GrindingProperties& t = parameters_.tissue[static_cast<std::size_t>(tissue)];
    return {t.specific_energy, t.force_ratio, rate};
  }
  double stall_speed(double rate, double engaged) const {
    return cylinder_stall_speed(grinding(0, rate), bur_.max_radius(), engaged, asked_.stall_torque);
  }
  // N·s/mm against the feed.
  double resistance(int tissue, double rate, double engaged) const {
    return cylinder_side_feed(grinding(tissue, rate), bur_.max_radius(), engaged, 1).against;
  }
  // mm, of the largest area of contact in enamel.
  double engaged_of(const Exact& exact) const {
    double most = 0;
    for (const auto& area : exact.area) most = std::max(most, area[0]);
    return most / (units::kPi * bur_.max_radius());
  }
  // N at which the stall speed is as stated.
  double rate_of_stall(double engaged) const {
    return asked_.stall_speed / stall_speed(1, engaged);
  }
  // Of the plateau, percent, where the bur leaves the enamel; k in N/mm.
  double peak(double rate, double engaged, double stiffness) {
    return peak_of_whole(stiffness * whole_ / resistance(0, rate, engaged));
  }
  // What the simulated device holds: below either limit it damps the spring.
  double largest_stiffness() const { return std::max(damping_limit_, friction_limit_); }

  static constexpr int kCount = 5;
  // Stall speed; resistance between the tissues'; beyond direct rendering; small difference; a
  // stiffness that the device holds.
  std::array<bool, kCount> at(double rate, double engaged, double stiffness, double peak) const {
    return {100 * std::abs(stall_speed(rate, engaged) / asked_.stall_speed - 1) <=
                asked_.stall_speed_percent,
            resistance(1, rate, engaged) <= asked_.resistance &&
                asked_.resistance <= resistance(0, rate, engaged),
            resistance(1, rate, engaged) > asked_.direct_limit, peak >= asked_.peak_percent,
            stiffness <= largest_stiffness()};
  }
  // The least k at which the difference is small, N/mm.
  double least_stiffness(double rate, double engaged) const {
    return least_of_whole_ * resistance(0, rate, engaged) / whole_;
  }
  const Feasibility& asked() const { return asked_; }

 private:
  static constexpr double kLeastRatio = 1e-2, kMostRatio = 1e2;  // k/B, 1/s

  // Of the whole head at the scene's rate. Points of the map with the same k/B are one.
  double peak_of_whole(double stiffness) {
    const long key = std::lround(1e6 * std::log(stiffness));
    {
      const std::lock_guard lock(mutex_);
      const auto known = peaks_.find(key);
      if (known != peaks_.end()) return known->second;
    }
    const Vec3 start(0, bur_.max_radius(), -bur_.head_length() / 2);
    const double peak = 100 * reference::share_of_plateau(scene_, start, depth_, speed_, stiffness);
    const std::lock_guard lock(mutex_);
    return peaks_.emplace(key, peak).first->second;
  }

  const Feasibility& asked_;
  const Parameters& parameters_;
  Bur bur_;
  reference::Scene scene_;
  double depth_, speed_, damping_limit_ = 0, friction_limit_ = 0;
  double whole_ = 0, least_of_whole_ = 0;  // B in enamel of the whole head, N·s/mm; N/mm
  std::mutex mutex_;
  std::unordered_map<long, double> peaks_;
};

struct Cell {
  double rate, stiffness, engaged, stall_speed, resistance, peak;
  std::array<bool, Statements::kCount> holds;
  int held() const { return static_cast<int>(std::count(holds.begin(), holds.end(), true)); }
};

std::vector<Cell> cells_of(Statements& s) {
  const Feasibility& f = s.asked();
  std::vector<Cell> cells;
  for (const double engaged : f.engaged)
    for (const double k : f.stiffnesses)
      for (const double rate : f.rotation_rates)
        cells.push_back({rate,
                         k,
                         engaged,
                         s.stall_speed(rate, engaged),
                         s.resistance(0, rate, engaged),
                         0,
                         {}});
  tbb::parallel_for(std::size_t{0}, cells.size(), [&](std::size_t i) {
    Cell& c = cells[i];
    c.peak = s.peak(c.rate, c.engaged, c.stiffness);
    c.holds = s.at(c.rate, c.engaged, c.stiffness, c.peak);
  });
  return cells;
}

MapPlot map_of(const Statements& s, const std::vector<Cell>& cells, double engaged,
               const std::string& file) {
  const Feasibility& f = s.asked();
  MapPlot plot;
  plot.file = file;
  plot.title =
      "What agrees with all that the paper states: " + std::to_string(engaged).substr(0, 3) +
      " mm of the bur engaged";
  plot.x_label = "rotation rate $N$ (rev/s)";
  plot.y_label = "coupling stiffness $k$ (N/mm)";
  plot.value_label = "largest force in enamel, of the plateau (%)";
  plot.least = 0;
  plot.most = 100;
  plot.logarithmic = false;
  plot.x = f.rotation_rates;
  plot.y = f.stiffnesses;
  plot.values.assign(plot.y.size(), {});
  plot.verdicts.assign(plot.y.size(), {});
  std::size_t n = 0;
  for (const Cell& c : cells) {
    if (c.engaged != engaged) continue;
    const std::size_t row = n++ / plot.x.size();
    plot.values[row].push_back(c.peak);
    plot.verdicts[row].push_back(c.held() == Statements::kCount       ? "all"
                                 : c.held() == Statements::kCount - 1 ? "all but one"
                                                                      : "fewer");
  }
  const double rate = s.rate_of_stall(engaged);
  const double least = s.least_stiffness(rate, engaged);
  MapPlot::Line small{
      "small difference (ours: " + std::to_string(f.peak_percent).substr(0, 2) + " %)", {}, {}};
  for (const double x : plot.x) {  // k/B is the same all along
    small.x.push_back(x);
    small.y.push_back(least * rate / x);
  }
  plot.lines = {{"stall at the stated speed", {rate, rate}, {plot.y.front(), plot.y.back()}},
                small,
                {"what the device holds",
                 {plot.x.front(), plot.x.back()},
                 {s.largest_stiffness(), s.largest_stiffness()}}};
  return plot;
}

void claim_runs(FigureReport& figure, const Experiment& experiment, Statements& s,
                const std::vector<Beside>& all) {
  const Run& first = experiment.runs.front();
  const std::string words = std::to_string(std::lround(s.asked().peak_percent)) + " % is ours";
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Beside& b = all[i];
    const std::string engine = name_of(b.outcome.parameters.engine);
    std::vector<Vec3> replayed;
    for (const StepRecord& row : b.outcome.replay.rows) replayed.push_back(row.grinding_force);
    const Difference exact = difference(b.coupled.force, b.coupled, b.direct);
    const Difference measured = difference(replayed, b.coupled, b.direct);
    const std::string title = experiment.runs[i].title;
    figure.claims.push_back(near("The coupled curve is exact: " + title, engine,
                                 "largest force in enamel, of the plateau", "%", "exact integral",
                                 exact.peak, measured.peak, kReplayAim));
    figure.claims.push_back(bound("The coupled curve differs little from the direct one: " + title,
                                  engine, "largest force in enamel, of the plateau", "%",
                                  "the paper; " + words, s.asked().peak_percent, measured.peak,
                                  true));
    figure.claims.push_back(
        near("The coupled curve is exact: " + title, engine,
             "time with more than 10 % of the plateau between coupled and direct, of that in "
             "contact",
             "%", "exact integral", exact.apart, measured.apart, kReplayAim, 100));
    const Parameters& p = b.outcome.parameters;
    if (experiment.runs[i].block.enamel == first.block.enamel)
      figure.claims.push_back(
          near("The map holds for a replay: " + title, engine,
               "largest force in enamel, of the plateau", "%", "k/B alone",
               s.peak(p.handpiece.rotation_rate, s.engaged_of(b.coupled), p.coupling.stiffness),
               measured.peak, kReplayAim));
    figure.claims.push_back(near("Torque in proportion to the speed: " + title, engine,
                                 "stall speed at the stated torque", "mm/s", "the paper",
                                 s.asked().stall_speed, stall_speed_of(b, s.asked().stall_torque),
                                 s.asked().stall_speed_percent));
  }
}

void claim_map(FigureReport& figure, const Statements& s, const std::vector<Cell>& cells) {
  const Feasibility& f = s.asked();
  const double whole = f.engaged.front(), rate = s.rate_of_stall(whole);
  const double enamel = s.resistance(0, rate, whole), dentin = s.resistance(1, rate, whole);
  for (const double engaged : f.engaged)
    figure.claims.push_back(
        near("The stall speed gives N only with the engaged length", "",
             "N of the stated stall, " + std::to_string(engaged).substr(0, 3) + " mm engaged",
             "rev/s", "N/L alone", rate * engaged / whole, s.rate_of_stall(engaged), 1e-6));
  figure.claims.push_back(near(
      "Stall and resistance agree", "", "resistance in enamel at the stated stall, any N and L",
      "N·s/mm", "the paper; " + std::to_string(std::lround(f.resistance_percent)) + " % is ours",
      f.resistance, enamel, f.resistance_percent));
  figure.claims.push_back(bound("The stated resistance lies between the tissues'", "",
                                "resistance in dentin", "N·s/mm", "the paper", f.resistance,
                                dentin));
  figure.claims.push_back(bound("The stated resistance lies between the tissues'", "",
                                "resistance in enamel", "N·s/mm", "the paper", f.resistance, enamel,
                                true));
  figure.claims.push_back(bound("Direct rendering can't render a tooth", "", "resistance in dentin",
                                "N·s/mm", "the paper", f.direct_limit, dentin, true));
  const double least = s.least_stiffness(rate, whole);
  figure.claims.push_back(bound("A small difference needs a stiffness that a Phantom Desktop holds",
                                "", "least k", "N/mm", "public practice for the device", kPractice,
                                least));
  figure.claims.push_back(bound("A small difference needs a stiffness that a Phantom Desktop holds",
                                "", "least k", "N/mm", "limit of the simulated device",
                                s.largest_stiffness(), least));
  long all = 0, in_practice = 0;
  for (const Cell& c : cells) {
    const bool holds = c.held() == Statements::kCount;
    all += holds;
    in_practice += holds && c.stiffness <= kPractice;
  }
  figure.claims.push_back(bound("All that the paper states holds at once", "",
                                "points of the map, k up to 1 N/mm", "1", "the paper", 1,
                                static_cast<double>(in_practice), true));
  figure.claims.push_back(bound("All that the paper states holds at once", "",
                                "points of the map, k up to what the simulated device holds", "1",
                                "the paper", 1, static_cast<double>(all), true));
}

std::string write_cells(FigureContext& context, const Experiment& experiment,
                        const std::vector<Cell>& cells) {
  std::vector<std::vector<double>> columns(11);
  for (const Cell& c : cells) {
    const double row[6] = {c.rate, c.stiffness, c.engaged, c.stall_speed, c.resistance, c.peak};
    for (std::size_t n = 0; n < 6; ++n) columns[n].push_back(row[n]);
    for (std::size_t n = 0; n < c.holds.size(); ++n) columns[6 + n].push_back(c.holds[n]);
  }
  return context.write_series(
      experiment, "map",
      {"rotation_rate_rev_s", "stiffness_n_per_mm", "engaged_mm", "stall_speed_mm_s",
       "resistance_enamel_n_s_per_mm", "peak_percent", "stall_holds", "resistance_holds",
       "beyond_direct_holds", "small_difference_holds", "device_holds"},
      columns);
}

// The closed forms are those of a cylinder, whose engaged length can't be more than its own.
void require_cylinders(const Experiment& experiment, const FigureOptions& o) {
  for (const Run& run : experiment.runs)
    if (run.bur.rfind("cylinder:", 0) != 0 || run.drive != Drive::kCoupled)
      throw Error(experiment.name + ": run " + run.name +
                  ": must be a cylinder in coupled drive; give bur = \"cylinder:D1.2xL3.0\"");
  const double length = make_bur(experiment.runs.front().bur, o.bur_library).head_length();
  for (const double engaged : experiment.feasibility.engaged)
    if (engaged > length)
      throw Error(experiment.name + ": map.engaged_mm: must not exceed the bur's length, " +
                  std::to_string(length).substr(0, 4) + " mm");
}

}  // namespace

FigureReport feasibility_figure(const Experiment& experiment, FigureContext& context) {
  const FigureOptions& o = context.options();
  require_cylinders(experiment, o);
  FigureReport figure;
  std::vector<Beside> all(experiment.runs.size());
  std::vector<FigureContext::Job> jobs;
  for (std::size_t i = 0; i < all.size(); ++i)
    jobs.push_back({experiment.name, [&, i] {
                      const Run& run = experiment.runs[i];
                      Parameters p = parameters_of(run, o.base);
                      p.engine = o.engines.front();
                      Run direct = run;
                      direct.drive = Drive::kDirect;
                      Beside& b = all[i];
                      b.path = context.path(run, p);
                      b.coupled = exact_answer(run, p, b.path, o.bur_library);
                      b.direct = exact_answer(direct, p, b.path, o.bur_library);
                      b.outcome = run_on(run, p, b.path, context.specimen(experiment, run, o.voxel),
                                         o.bur_library);
                    }});
  context.run(jobs);

  for (std::size_t i = 0; i < all.size(); ++i) {
    const Run& run = experiment.runs[i];
    RunReport report = report_of(run, all[i].outcome, o.voxel, &all[i].coupled);
    report.trace = context.write_trace(experiment, run.name, run, all[i].outcome);
    report.exact =
        context.write_exact(experiment, run.name + "-exact", all[i].path, all[i].coupled);
    const std::string direct =
        context.write_exact(experiment, run.name + "-direct", all[i].path, all[i].direct);
    Plot plot;
    plot.file = experiment.name + "/" + run.name;
    plot.title = "Coupled beside direct drive: " + run.title;
    plot.panels =
        force_panels({{"direct", direct, "", "thin"}, {"coupled", report.trace, ""}}, report.exact);
    plot.tissues = report.exact;
    figure.plots.push_back(plot);
    figure.runs.push_back(report);
  }

  const Run& first = experiment.runs.front();
  const Parameters& parameters = all.front().outcome.parameters;
  const std::vector<HandleSample>& path = all.front().path;
  const double speed = (path.back().pose.position - path.front().pose.position).norm() /
                       (path.back().time - path.front().time);
  Statements statements(experiment, first, parameters, o.bur_library, speed);
  const std::vector<Cell> cells = cells_of(statements);
  write_cells(context, experiment, cells);
  for (const double engaged : experiment.feasibility.engaged)
    figure.maps.push_back(
        map_of(statements, cells, engaged,
               experiment.name + "/map-" + std::to_string(std::lround(1000 * engaged)) + "-um"));
  claim_runs(figure, experiment, statements, all);
  claim_map(figure, statements, cells);
  return figure;
}

}  // namespace toothprep::figures
