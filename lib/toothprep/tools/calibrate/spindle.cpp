#include "toothprep/tools/calibrate/spindle.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "toothprep/step/core/statistics.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/session/spindle.h"
#include "toothprep/tools/calibrate/uncertainty.h"

namespace toothprep {
namespace {

constexpr double kWorstStd = 0.25;     // relative, of tau_s
constexpr double kUnknownShare = 0.5;  // of the torque, from tissue whose u isn't known
constexpr double kWorstInertiaStd = 0.5;
constexpr int kPasses = 100;
constexpr int kHalvings = 40;
constexpr double kLongestStride = 0.5;  // of the logarithms
constexpr double kNudge = 1e-4;         // of the logarithms, for derivatives
constexpr double kSettled = 1e-7;       // of the logarithms
constexpr double kExponents[] = {1, 0.5, 1.5, 2, 2.5, 3, 4, 5, 6, 8};
constexpr double kTimeConstants[] = {0.02, 0.1, 0.5, 2};  // s, 2 pi J N0 / tau_s to start from
constexpr int kFirstSpeeds = 5;                           // whose median is the initial speed
constexpr std::size_t kLeastRunDown = 20;                 // samples with the motor off

// A step of a recording, with the load that the fit's model puts on the spindle.
struct Row {
  double speed = 0, load = 0;  // N, c
  PerTissue<double> by_u{};    // dc/du_k
  bool pedal = false;
  bool fitted = false;   // included in the fit
  bool stalled = false;  // the recorded speed is used as it is
};

struct Recording {
  std::size_t begin = 0, end = 0;  // its rows
  double initial_speed = 0;        // rev/s, before them
};

struct Samples {
  std::vector<Row> rows;
  std::vector<Recording> recordings;
  std::size_t fitted = 0, running_down = 0;  // numbers of rows
  double step = 0;                           // s
  double load = 0, known_load = 0;           // sums: in all, and of tissues whose u is known
};

Samples samples_of(const std::vector<RecordedMotion>& motions, const std::vector<ForceBasis>& bases,
                   const FitResult& fit) {
  Samples samples;
  const PerTissue<GrindingProperties> tissue = modelled_tissue(fit);
  for (std::size_t r = 0; r < motions.size(); ++r) {
    const auto& [path, spindle] = motions[r];
    if (spindle.rate.empty()) continue;
    const auto first = spindle.rate.begin();
    const auto few = std::min<std::ptrdiff_t>(kFirstSpeeds, std::ssize(spindle.rate));
    samples.recordings.push_back({samples.rows.size(), samples.rows.size() + path.size() - 1,
                                  quantile(std::vector<double>(first, first + few), 0.5)});
    samples.step = bases[r].step;
    for (std::size_t i = 1; i < path.size(); ++i) {
      Row row;
      row.speed = spindle.rate[i];
      row.pedal = path[i].buttons & kPedalButton;
      row.stalled = !(row.speed > 0) || (!spindle.stalled.empty() && spindle.stalled[i]);
      row.fitted = row.pedal && !row.stalled;
      for (int k = 0; k < kTissueCount && row.fitted; ++k) {
        if (!bases[r].touched(k)) continue;
        row.by_u[k] = bases[r].tissue[k].torque[i] * spindle.rate[i];
        const double load = tissue[k].specific_energy * row.by_u[k];
        row.load += load;
        samples.load += load;
        if (fit.tissue[k].identifiable) samples.known_load += load;
      }
      samples.fitted += row.fitted ? 1 : 0;
      samples.rows.push_back(row);
    }
  }
  return samples;
}

// With a rotor also the rows in which it runs down, the motor off.
void include_run_down(Samples& samples, double rate) {
  for (Row& row : samples.rows)
    if (!row.pedal && row.speed > 0.05 * rate && row.speed < 0.95 * rate) {
      row.fitted = true;
      ++samples.fitted, ++samples.running_down;
    }
}

// The speed after a step of a row.
double speed_after(const Handpiece& handpiece, const Row& row, double load, double before,
                   double step) {
  if (row.stalled) return row.speed;
  const Spindle spindle(handpiece, row.pedal, before, step);
  if (!(load > 0) || !spindle.turns()) return spindle.free_rate();
  const double rate = spindle.rate_with(load);
  // Overloaded: with inertia it stops, without it its last operating point is used.
  return rate == 0 && handpiece.rotor_inertia == 0 ? spindle.rate_of_greatest_power() : rate;
}

// The spindle's speed in every row, step by step; `more` is added to u of `tissue`.
std::vector<double> speeds(const Handpiece& handpiece, const Samples& samples, int tissue = 0,
                           double more = 0) {
  std::vector<double> speed(samples.rows.size());
  for (const Recording& recording : samples.recordings) {
    double before = recording.initial_speed;
    for (std::size_t i = recording.begin; i < recording.end; ++i) {
      const Row& row = samples.rows[i];
      const double load = row.load + more * row.by_u[tissue];
      before = speed[i] = speed_after(handpiece, row, load, before, samples.step);
    }
  }
  return speed;
}

using Fields = std::vector<double Handpiece::*>;  // what is fitted, by its logarithm

// The handpiece as it is being fitted.
struct Model {
  Handpiece handpiece;
  Fields fields;
  double scale = 0;  // rev/s, of the residuals

  Handpiece moved(const Eigen::VectorXd& by) const {
    Handpiece h = handpiece;
    for (std::size_t f = 0; f < fields.size(); ++f)
      h.*fields[f] *= std::exp(by[static_cast<Eigen::Index>(f)]);
    return h;
  }
  // The derivatives by the fields' logarithms, and by each u_k if wanted; a row for each sample.
  Eigen::MatrixXd derivatives(const Samples& samples, const PerTissue<double>* u) const {
    const auto n = static_cast<Eigen::Index>(samples.rows.size());
    const auto own = static_cast<Eigen::Index>(fields.size());
    Eigen::MatrixXd by = Eigen::MatrixXd::Zero(n, own + (u ? kTissueCount : 0));
    const auto put = [&](Eigen::Index column, const std::vector<double>& up,
                         const std::vector<double>& down, double width) {
      for (Eigen::Index i = 0; i < n; ++i)
        by(i, column) =
            (up[static_cast<std::size_t>(i)] - down[static_cast<std::size_t>(i)]) / width;
    };
    for (Eigen::Index f = 0; f < own; ++f) {
      const Eigen::VectorXd nudge = kNudge * Eigen::VectorXd::Unit(own, f);
      put(f, speeds(moved(nudge), samples), speeds(moved(-nudge), samples), 2 * kNudge);
    }
    for (int k = 0; u && k < kTissueCount; ++k) {
      const double more = kNudge * (*u)[k];
      if (more > 0)
        put(own + k, speeds(handpiece, samples, k, more), speeds(handpiece, samples, k, -more),
            2 * more);
    }
    return by;
  }
};

double residual(const Samples& samples, const std::vector<double>& speed, std::size_t i) {
  return speed[i] - samples.rows[i].speed;
}

double robust_scale(const Samples& samples, const std::vector<double>& speed) {
  std::vector<double> size;
  for (std::size_t i = 0; i < speed.size(); ++i)
    if (samples.rows[i].fitted) size.push_back(std::abs(residual(samples, speed, i)));
  return kSigmaOfMedian * quantile(std::move(size), 0.5);
}

double loss(const Samples& samples, const std::vector<double>& speed, double scale,
            std::size_t begin, std::size_t end) {
  double sum = 0;
  for (std::size_t i = begin; i < end; ++i)
    if (samples.rows[i].fitted)
      sum += loss_at(RobustLoss::kHuber, residual(samples, speed, i) / scale).rho;
  return sum;
}

struct Sums {
  Eigen::MatrixXd H, g;  // g: by the residual, and by each u_k
};

Sums sums_of(const Model& model, const Samples& samples, const std::vector<double>& speed,
             const Eigen::MatrixXd& by, std::size_t begin, std::size_t end) {
  const auto own = static_cast<Eigen::Index>(model.fields.size());
  const Eigen::Index beside = by.cols() - own;
  Sums sums{Eigen::MatrixXd::Zero(own, own), Eigen::MatrixXd::Zero(own, 1 + beside)};
  for (std::size_t i = begin; i < end; ++i) {
    if (!samples.rows[i].fitted) continue;
    const LossAt at = loss_at(RobustLoss::kHuber, residual(samples, speed, i) / model.scale);
    const Eigen::VectorXd row = by.row(static_cast<Eigen::Index>(i)).transpose() / model.scale;
    sums.H += at.slope * row.head(own) * row.head(own).transpose();
    sums.g.col(0) += at.psi * row.head(own);
    for (Eigen::Index k = 0; k < beside; ++k)
      sums.g.col(1 + k) += at.slope * row[own + k] * row.head(own);
  }
  return sums;
}

// Slope of the straight line of N over T through N0 at T = 0. (Rows of a spin-up, without torque,
// have no weight in it.)
double slope_of(const Samples& samples, double free_rate) {
  double tt = 0, tn = 0;
  for (const Row& row : samples.rows) {
    if (!row.fitted) continue;
    const double torque = row.load / row.speed;
    tt += torque * torque, tn += torque * (row.speed - free_rate);
  }
  return tn / std::max(tt, 1e-300);
}

// Gauss and Newton from a first guess. A step that doesn't lower the loss is halved.
Model fitted(Model model, const Samples& samples) {
  const std::size_t n = samples.rows.size();
  for (int pass = 0; pass < kPasses; ++pass) {
    const std::vector<double> speed = speeds(model.handpiece, samples);
    model.scale = std::max(robust_scale(samples, speed), 1e-9 * model.handpiece.rotation_rate);
    const Sums sums = sums_of(model, samples, speed, model.derivatives(samples, nullptr), 0, n);
    Eigen::VectorXd by = -solve_scaled(sums.H, sums.g.col(0));
    by *= std::min(1.0, kLongestStride / std::max(by.cwiseAbs().maxCoeff(), 1e-300));
    const double before = loss(samples, speed, model.scale, 0, n);
    for (int half = 0; half < kHalvings; ++half, by /= 2)
      if (by.cwiseAbs().maxCoeff() < kSettled / 2 ||
          loss(samples, speeds(model.moved(by), samples), model.scale, 0, n) < before)
        break;
    model.handpiece = model.moved(by);
    if (by.cwiseAbs().maxCoeff() < kSettled) break;
  }
  return model;
}

// The recordings divided into blocks longer than the residuals' correlation time.
struct Piece {
  std::size_t begin, end;
};
std::vector<Piece> pieces_of(const Samples& samples, const std::vector<double>& speed) {
  std::vector<double> rest;
  for (std::size_t i = 0; i < speed.size(); ++i)
    if (samples.rows[i].fitted) rest.push_back(residual(samples, speed, i));
  const double step = samples.step, duration = static_cast<double>(rest.size()) * step;
  const double block =
      std::clamp(10 * correlation_time(rest, step), 20 * step, std::max(20 * step, duration / 30));
  const auto length = static_cast<std::size_t>(block / step);
  std::vector<Piece> pieces;
  for (const Recording& r : samples.recordings)
    for (std::size_t begin = r.begin; begin < r.end; begin += length)
      pieces.push_back({begin, std::min(begin + length, r.end)});
  return pieces;
}

// Of the fields' logarithms, by block bootstrap, each replicate with a draw of u.
Eigen::MatrixXd covariance_of(const Model& model, const Samples& samples,
                              const std::vector<double>& speed, const std::vector<Piece>& pieces,
                              const FitResult& fit, std::uint64_t seed) {
  const PerTissue<GrindingProperties> tissue = modelled_tissue(fit);
  PerTissue<double> u{};
  for (int k = 0; k < kTissueCount; ++k) u[k] = tissue[k].specific_energy;
  const Eigen::MatrixXd by = model.derivatives(samples, &u);
  std::vector<Sums> blocks;
  for (const Piece& p : pieces)
    blocks.push_back(sums_of(model, samples, speed, by, p.begin, p.end));
  const Eigen::Index draws = fit.draws.cols(), own = blocks.front().H.rows();
  const auto replicates = draws > 0 ? draws : Eigen::Index{500};
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(own, own);
  for (Eigen::Index replicate = 0; replicate < replicates; ++replicate) {
    std::seed_seq seeds{seed, static_cast<std::uint64_t>(replicate), std::uint64_t{77}};
    std::mt19937_64 random(seeds);
    Sums total{Eigen::MatrixXd::Zero(own, own), Eigen::MatrixXd::Zero(own, 1 + kTissueCount)};
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      const Sums& one = blocks[random() % blocks.size()];
      total.H += one.H;
      total.g += one.g;
    }
    Eigen::VectorXd g = total.g.col(0);
    for (std::size_t name = 0; name < fit.names.size(); ++name)
      for (int k = 0; k < kTissueCount; ++k)
        if (fit.names[name] == std::string(kTissueNames[k]) + ".u")
          g += total.g.col(1 + k) * (fit.draws(static_cast<Eigen::Index>(name), replicate) - u[k]);
    const Eigen::VectorXd change = -solve_scaled(total.H, g);
    covariance += change * change.transpose() / static_cast<double>(replicates);
  }
  return covariance;
}

// The fit with the exponent of least loss, and the exponents that the recordings do not distinguish
// from it: their loss exceeds the least by no more than two standard errors of the difference, which
// is estimated from the blocks.
struct Exponents {
  Model best;
  std::vector<double> alike;
};
Exponents with_exponents(const Model& start, const Samples& samples) {
  std::vector<Model> models;
  double scale = std::numeric_limits<double>::infinity();
  for (const double k : kExponents) {
    Model guess = models.empty() ? start : models.front();
    // At small torques N = N0 (1 - T / (k tau_s)).
    guess.handpiece.stall_torque *= guess.handpiece.droop_exponent / k;
    guess.handpiece.droop_exponent = k;
    models.push_back(fitted(guess, samples));
    scale = std::min(scale, models.back().scale);
  }
  const auto total = [&](const Model& m) {
    return loss(samples, speeds(m.handpiece, samples), scale, 0, samples.rows.size());
  };
  const Model best =
      *std::min_element(models.begin(), models.end(),
                        [&](const Model& a, const Model& b) { return total(a) < total(b); });
  const std::vector<double> at_best = speeds(best.handpiece, samples);
  const std::vector<Piece> pieces = pieces_of(samples, at_best);
  Exponents result{best, {}};
  for (const Model& m : models) {
    const std::vector<double> speed = speeds(m.handpiece, samples);
    double sum = 0, squares = 0;
    for (const Piece& p : pieces) {
      const double more = loss(samples, speed, scale, p.begin, p.end) -
                          loss(samples, at_best, scale, p.begin, p.end);
      sum += more, squares += more * more;
    }
    if (sum <= 2 * std::sqrt(squares)) result.alike.push_back(m.handpiece.droop_exponent);
  }
  std::sort(result.alike.begin(), result.alike.end());
  return result;
}

// The time in which a rotor stops from the given rate, from the slope of the recorded run-downs.
double recorded_run_down(const Samples& samples, double rate) {
  double fall = 0, duration = 0;
  for (const Recording& r : samples.recordings)
    for (std::size_t i = r.begin + 1; i < r.end; ++i) {
      const Row &last = samples.rows[i - 1], &row = samples.rows[i];
      if (!row.fitted || row.pedal || !last.fitted || last.pedal) continue;
      fall += last.speed - row.speed;
      duration += samples.step;
    }
  return fall > 0 ? rate * duration / fall : 1;
}

// Starting from the time constant of least loss.
Model with_rotor(Model model, const Samples& samples) {
  const bool runs_down = samples.running_down >= kLeastRunDown;
  Handpiece& h = model.handpiece;
  if (runs_down) h.run_down = recorded_run_down(samples, h.rotation_rate);
  Model best = model;
  double least = std::numeric_limits<double>::infinity();
  const double scale = 0.02 * h.rotation_rate;
  for (const double constant : kTimeConstants) {
    h.rotor_inertia = constant * h.stall_torque / (2 * units::kPi * h.rotation_rate);
    const double at = loss(samples, speeds(h, samples), scale, 0, samples.rows.size());
    if (at < least) least = at, best = model;
  }
  best.fields.push_back(&Handpiece::rotor_inertia);
  if (runs_down) best.fields.push_back(&Handpiece::run_down);
  return fitted(best, samples);
}

Estimate estimate(double value, double relative, double student) {
  return {value, value * relative, value * std::exp(-student * relative),
          value * std::exp(student * relative)};
}

}  // namespace

DroopFit fit_droop(const std::vector<RecordedMotion>& motions, const std::vector<ForceBasis>& bases,
                   const FitResult& fit, const DroopOptions& options) {
  DroopFit result;
  Samples samples = samples_of(motions, bases, fit);
  if (samples.fitted < 100) {
    result.why_not = "no speed was recorded";
    return result;
  }
  if (!(samples.load > 0) || samples.known_load < kUnknownShare * samples.load) {
    result.why_not =
        "u isn't known of the tissue that loads the spindle, so its torque isn't either";
    return result;
  }
  std::vector<double> recorded;
  for (const Row& row : samples.rows)
    if (row.fitted) recorded.push_back(row.speed);
  const double guess = quantile(recorded, 0.9), slope = slope_of(samples, guess);
  result.largest_fall = 1 - quantile(std::move(recorded), 0.01) / guess;
  if (!(slope < 0)) {
    result.why_not = "the recorded speed doesn't fall with the torque";
    return result;
  }
  Model model{options.handpiece, {&Handpiece::rotation_rate, &Handpiece::stall_torque}, 0};
  model.handpiece.model = HandpieceModel::kDroop;
  model.handpiece.rotation_rate = guess;
  model.handpiece.stall_torque = guess / -slope;
  if (options.rotor) {
    include_run_down(samples, guess);
    model = with_rotor(model, samples);
  } else {
    model = fitted(model, samples);
  }
  if (options.exponent) {
    const Exponents found = with_exponents(model, samples);
    model = found.best;
    result.exponents_like_the_best = found.alike;
  }

  const std::vector<double> speed = speeds(model.handpiece, samples);
  double square = 0;
  for (std::size_t i = 0; i < speed.size(); ++i)
    if (samples.rows[i].fitted) square += std::pow(residual(samples, speed, i), 2);
  result.residual_rms = std::sqrt(square / static_cast<double>(samples.fitted));
  const std::vector<Piece> pieces = pieces_of(samples, speed);
  const Eigen::MatrixXd covariance =
      covariance_of(model, samples, speed, pieces, fit, options.seed);
  const Eigen::VectorXd std = covariance.diagonal().cwiseSqrt();
  if (!(std[1] <= kWorstStd)) {
    result.why_not =
        fmt::format("the speed falls by only {:.1f} %: the stall torque is known to {:.0f} %",
                    100 * result.largest_fall, std::min(100 * std[1], 999.0));
    return result;
  }
  result.identifiable = true;
  result.exponent = model.handpiece.droop_exponent;
  const double student = student_95(
      std::max(1.0, static_cast<double>(pieces.size()) - static_cast<double>(std.size())));
  const auto put = [&](Eigen::Index field) {
    return estimate(model.handpiece.*model.fields[static_cast<std::size_t>(field)], std[field],
                    student);
  };
  result.rate = put(0);
  result.stall_torque = put(1);
  result.correlation = covariance(0, 1) / std::max(std[0] * std[1], 1e-300);
  if (options.rotor && std[2] <= kWorstInertiaStd) {
    result.inertia = put(2);
    if (std.size() > 3) result.run_down = put(3);
  } else if (options.rotor) {
    result.inertia_why_not = fmt::format(
        "the speed follows the torque too quickly, or hardly changes: the relative "
        "uncertainty of the inertia is {:.0f} %",
        std::min(100 * std[2], 999.0));
  }
  return result;
}

void check_torque(const MeasuredRecording& recording, const ForceBasis& basis, const FitResult& fit,
                  RecordingFit& result) {
  if (recording.torque.empty()) return;
  const PerTissue<GrindingProperties> tissue = modelled_tissue(fit);
  double both = 0, square = 0, rest = 0, count = 0;
  const auto each = [&](auto use) {
    const auto& samples = recording.motion.samples;
    for (std::size_t j = 0; j < samples.size(); ++j) {
      if (!recording.stalled.empty() && recording.stalled[j]) continue;
      const double place = (samples[j].time - basis.start) / basis.step;
      if (place < 0 || place > static_cast<double>(basis.size - 1)) continue;
      const auto i = static_cast<std::size_t>(place + 0.5);
      if (!(basis.removal[i] > 0)) continue;
      use(torque_at(basis, i, tissue), recording.torque[j]);
    }
  };
  each([&](double modelled, double measured) {
    both += modelled * measured;
    square += modelled * modelled;
  });
  if (!(square > 0)) return;
  result.torque_factor = both / square;
  each([&](double modelled, double measured) {
    rest += (measured - modelled) * (measured - modelled);
    ++count;
  });
  result.torque_rms = std::sqrt(rest / count);
}

}  // namespace toothprep
