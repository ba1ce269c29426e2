#include "toothprep/tools/calibrate/spindle.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "toothprep/step/core/statistics.h"
#include "toothprep/tools/calibrate/uncertainty.h"

namespace toothprep {
namespace {

constexpr double kWorstStd = 0.25;     // relative, of tau_s
constexpr double kUnknownShare = 0.5;  // of the torque, from tissue whose u isn't known
constexpr int kPasses = 100;
constexpr int kHalvings = 40;
constexpr double kLeastRoot = 0.05;  // of sqrt(1 - x): next to the collapse there is no slope

struct Sample {
  double speed, load;        // N, c
  PerTissue<double> by_u{};  // dc/du_k
};

// The model and its derivatives by log N0, log tau_s and c.
struct Model {
  double speed, by_rate, by_stall, by_load;
  Model(double rate, double stall, double load) {
    const double x = 4 * load / (rate * stall);
    const double root = std::max(std::sqrt(std::max(1 - x, 0.0)), kLeastRoot);
    speed = rate / 2 * (1 + root);
    by_rate = speed + rate * x / (4 * root);
    by_stall = rate * x / (4 * root);
    by_load = -1 / (stall * root);
  }
};

struct Sums {
  Eigen::Matrix2d H = Eigen::Matrix2d::Zero();
  Eigen::Matrix<double, 2, 1 + kTissueCount> g =
      Eigen::Matrix<double, 2, 1 + kTissueCount>::Zero();  // by the residual, and by each u_k
};

// The samples in which the spindle turned, with the load that the fit's model puts on it.
struct Samples {
  std::vector<Sample> all;
  std::vector<std::size_t> starts;  // of each recording
  double step = 0;                  // s
  double load = 0, known_load = 0;  // sums: in all, and of tissues whose u is known
};
Samples samples_of(const std::vector<RecordedMotion>& motions, const std::vector<ForceBasis>& bases,
                   const FitResult& fit) {
  Samples samples;
  const PerTissue<GrindingProperties> tissue = modelled_tissue(fit);
  for (std::size_t r = 0; r < motions.size(); ++r) {
    const auto& [path, spindle] = motions[r];
    if (spindle.rate.empty()) continue;
    samples.starts.push_back(samples.all.size());
    samples.step = bases[r].step;
    for (std::size_t i = 1; i < path.size(); ++i) {
      if (!(path[i].buttons & kPedalButton) || !(spindle.rate[i] > 0)) continue;
      if (!spindle.stalled.empty() && spindle.stalled[i]) continue;
      Sample s{spindle.rate[i], 0, {}};
      for (int k = 0; k < kTissueCount; ++k) {
        if (!bases[r].touched(k)) continue;
        s.by_u[k] = bases[r].tissue[k].torque[i] * spindle.rate[i];
        const double load = tissue[k].specific_energy * s.by_u[k];
        s.load += load;
        samples.load += load;
        if (fit.tissue[k].identifiable) samples.known_load += load;
      }
      samples.all.push_back(s);
    }
  }
  return samples;
}

// N0 and tau_s as they are being fitted.
struct Droop {
  double rate = 0, stall = 0;  // rev/s, N·mm
  double scale = 0;            // rev/s, of the residuals

  double residual(const Sample& s) const { return Model(rate, stall, s.load).speed - s.speed; }
  Sums sums(const std::vector<Sample>& samples, std::size_t begin, std::size_t end) const {
    Sums sums;
    for (std::size_t i = begin; i < end; ++i) {
      const Model m(rate, stall, samples[i].load);
      const LossAt at = loss_at(RobustLoss::kHuber, (m.speed - samples[i].speed) / scale);
      const Eigen::Vector2d J(m.by_rate / scale, m.by_stall / scale);
      sums.H += at.slope * J * J.transpose();
      sums.g.col(0) += at.psi * J;
      for (int k = 0; k < kTissueCount; ++k)
        sums.g.col(1 + k) += at.slope * (m.by_load * samples[i].by_u[k] / scale) * J;
    }
    return sums;
  }
};

// Slope of the straight line through N over T.
double slope_of(const std::vector<Sample>& samples) {
  double t = 0, n = 0, tt = 0, tn = 0;
  for (const Sample& s : samples) {
    const double torque = s.load / s.speed;
    t += torque, n += s.speed, tt += torque * torque, tn += torque * s.speed;
  }
  const auto count = static_cast<double>(samples.size());
  return (tn - t * n / count) / std::max(tt - t * t / count, 1e-300);
}

// Gauss and Newton from a first guess. A step that doesn't lower the loss is halved.
Droop fitted(Droop droop, const std::vector<Sample>& samples) {
  const auto loss = [&samples](const Droop& d) {
    double sum = 0;
    for (const Sample& s : samples) sum += loss_at(RobustLoss::kHuber, d.residual(s) / d.scale).rho;
    return sum;
  };
  for (int pass = 0; pass < kPasses; ++pass) {
    std::vector<double> size;
    for (const Sample& s : samples) size.push_back(std::abs(droop.residual(s)));
    droop.scale = std::max(kSigmaOfMedian * quantile(std::move(size), 0.5), 1e-9 * droop.rate);
    const Sums sums = droop.sums(samples, 0, samples.size());
    Eigen::VectorXd by = -solve_scaled(sums.H, sums.g.col(0));
    by = by.cwiseMax(-0.5).cwiseMin(0.5);
    const double before = loss(droop);
    Droop next = droop;
    for (int half = 0; half < kHalvings; ++half, by /= 2) {
      next.rate = droop.rate * std::exp(by[0]);
      next.stall = droop.stall * std::exp(by[1]);
      if (loss(next) < before) break;
    }
    droop = next;
    if (by.cwiseAbs().maxCoeff() < 1e-10) break;
  }
  return droop;
}

// Of pieces longer than the residuals' correlation.
std::vector<Sums> blocks_of(const Droop& droop, const Samples& samples,
                            const std::vector<double>& residual) {
  const double step = samples.step, duration = static_cast<double>(samples.all.size()) * step;
  const double block = std::clamp(10 * correlation_time(residual, step), 20 * step,
                                  std::max(20 * step, duration / 30));
  const auto length = static_cast<std::size_t>(block / step);
  std::vector<Sums> blocks;
  for (std::size_t r = 0; r < samples.starts.size(); ++r) {
    const std::size_t last =
        r + 1 < samples.starts.size() ? samples.starts[r + 1] : samples.all.size();
    for (std::size_t begin = samples.starts[r]; begin < last; begin += length)
      blocks.push_back(droop.sums(samples.all, begin, std::min(begin + length, last)));
  }
  return blocks;
}

// Of log N0 and log tau_s: the blocks drawn anew, each time with a draw of u.
Eigen::Matrix2d covariance_of(const std::vector<Sums>& blocks, const FitResult& fit,
                              std::uint64_t seed) {
  const PerTissue<GrindingProperties> tissue = modelled_tissue(fit);
  const Eigen::Index draws = fit.draws.cols();
  const auto replicates = draws > 0 ? draws : Eigen::Index{500};
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
  for (Eigen::Index replicate = 0; replicate < replicates; ++replicate) {
    std::seed_seq seeds{seed, static_cast<std::uint64_t>(replicate), std::uint64_t{77}};
    std::mt19937_64 random(seeds);
    Sums total;
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      const Sums& one = blocks[random() % blocks.size()];
      total.H += one.H;
      total.g += one.g;
    }
    Eigen::Vector2d g = total.g.col(0);
    for (std::size_t name = 0; name < fit.names.size(); ++name)
      for (int k = 0; k < kTissueCount; ++k)
        if (fit.names[name] == std::string(kTissueNames[k]) + ".u")
          g += total.g.col(1 + k) *
               (fit.draws(static_cast<Eigen::Index>(name), replicate) - tissue[k].specific_energy);
    const Eigen::Vector2d by = -solve_scaled(total.H, g);
    covariance += by * by.transpose() / static_cast<double>(replicates);
  }
  return covariance;
}

Estimate estimate(double value, double relative, double student) {
  return {value, value * relative, value * std::exp(-student * relative),
          value * std::exp(student * relative)};
}

}  // namespace

DroopFit fit_droop(const std::vector<RecordedMotion>& motions, const std::vector<ForceBasis>& bases,
                   const FitResult& fit, std::uint64_t seed) {
  DroopFit result;
  const Samples samples = samples_of(motions, bases, fit);
  if (samples.all.size() < 100) {
    result.why_not = "no speed was recorded";
    return result;
  }
  if (!(samples.load > 0) || samples.known_load < kUnknownShare * samples.load) {
    result.why_not =
        "u isn't known of the tissue that loads the spindle, so its torque isn't either";
    return result;
  }
  std::vector<double> speeds;
  for (const Sample& s : samples.all) speeds.push_back(s.speed);
  const double guess = quantile(speeds, 0.9), slope = slope_of(samples.all);
  result.largest_fall = 1 - quantile(std::move(speeds), 0.01) / guess;
  if (!(slope < 0)) {
    result.why_not = "the recorded speed doesn't fall with the torque";
    return result;
  }
  const Droop droop = fitted({guess, guess / -slope, 0}, samples.all);

  std::vector<double> residual;
  double square = 0;
  for (const Sample& s : samples.all) {
    residual.push_back(droop.residual(s));
    square += residual.back() * residual.back();
  }
  result.residual_rms = std::sqrt(square / static_cast<double>(samples.all.size()));
  const std::vector<Sums> blocks = blocks_of(droop, samples, residual);
  const Eigen::Matrix2d covariance = covariance_of(blocks, fit, seed);
  const double rate_std = std::sqrt(covariance(0, 0)), stall_std = std::sqrt(covariance(1, 1));
  if (!(stall_std <= kWorstStd)) {
    result.why_not =
        fmt::format("the speed falls by only {:.1f} %: the stall torque is known to {:.0f} %",
                    100 * result.largest_fall, std::min(100 * stall_std, 999.0));
    return result;
  }
  result.identifiable = true;
  const double student = student_95(std::max(1.0, static_cast<double>(blocks.size()) - 2));
  result.rate = estimate(droop.rate, rate_std, student);
  result.stall_torque = estimate(droop.stall, stall_std, student);
  result.correlation = covariance(0, 1) / std::max(rate_std * stall_std, 1e-300);
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
