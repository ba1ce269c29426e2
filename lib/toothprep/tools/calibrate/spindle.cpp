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
constexpr int kPasses = 30;
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

}  // namespace

DroopFit fit_droop(const std::vector<RecordedMotion>& motions, const std::vector<ForceBasis>& bases,
                   const FitResult& fit, std::uint64_t seed) {
  DroopFit result;
  const PerTissue<GrindingProperties> tissue = modelled_tissue(fit);
  std::vector<Sample> samples;
  std::vector<std::size_t> starts;  // of each recording
  double known = 0, all = 0, step = 0;
  for (std::size_t r = 0; r < motions.size(); ++r) {
    const auto& [path, spindle] = motions[r];
    if (spindle.rate.empty()) continue;
    starts.push_back(samples.size());
    step = bases[r].step;
    for (std::size_t i = 1; i < path.size(); ++i) {
      if (!(path[i].buttons & kPedalButton) || !(spindle.rate[i] > 0)) continue;
      if (!spindle.stalled.empty() && spindle.stalled[i]) continue;
      Sample s{spindle.rate[i], 0, {}};
      for (int k = 0; k < kTissueCount; ++k) {
        if (!bases[r].touched(k)) continue;
        s.by_u[k] = bases[r].tissue[k].torque[i] * spindle.rate[i];
        const double load = tissue[k].specific_energy * s.by_u[k];
        s.load += load;
        all += load;
        if (fit.tissue[k].identifiable) known += load;
      }
      samples.push_back(s);
    }
  }
  if (samples.size() < 100) {
    result.why_not = "no speed was recorded";
    return result;
  }
  if (!(all > 0) || known < kUnknownShare * all) {
    result.why_not =
        "u isn't known of the tissue that loads the spindle, so its torque isn't either";
    return result;
  }

  // A first guess from the straight line through N over T.
  double t = 0, n = 0, tt = 0, tn = 0;
  std::vector<double> speeds;
  for (const Sample& s : samples) {
    const double torque = s.load / s.speed;
    t += torque, n += s.speed, tt += torque * torque, tn += torque * s.speed;
    speeds.push_back(s.speed);
  }
  const auto count = static_cast<double>(samples.size());
  const double slope = (tn - t * n / count) / std::max(tt - t * t / count, 1e-300);
  double rate = quantile(speeds, 0.9);
  result.largest_fall = 1 - quantile(speeds, 0.01) / rate;
  if (!(slope < 0)) {
    result.why_not = "the recorded speed doesn't fall with the torque";
    return result;
  }
  double stall = rate / -slope, scale = 0;
  const auto residual_of = [&](const Sample& s) {
    return Model(rate, stall, s.load).speed - s.speed;
  };
  const auto sums_of = [&](std::size_t begin, std::size_t end) {
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
  };
  for (int pass = 0; pass < kPasses; ++pass) {
    std::vector<double> size;
    for (const Sample& s : samples) size.push_back(std::abs(residual_of(s)));
    scale = std::max(kSigmaOfMedian * quantile(size, 0.5), 1e-9 * rate);
    const Sums sums = sums_of(0, samples.size());
    const Eigen::VectorXd by = -solve_scaled(sums.H, sums.g.col(0));
    rate *= std::exp(std::clamp(by[0], -0.5, 0.5));
    stall *= std::exp(std::clamp(by[1], -0.5, 0.5));
    if (by.cwiseAbs().maxCoeff() < 1e-10) break;
  }

  // Blocks of the residuals drawn anew, each with a draw of u.
  std::vector<double> residual;
  double square = 0;
  for (const Sample& s : samples) {
    residual.push_back(residual_of(s));
    square += residual.back() * residual.back();
  }
  result.residual_rms = std::sqrt(square / count);
  const double duration = count * step;
  const double block = std::clamp(10 * correlation_time(residual, step), 20 * step,
                                  std::max(20 * step, duration / 30));
  const auto length = static_cast<std::size_t>(block / step);
  std::vector<Sums> blocks;
  starts.push_back(samples.size());
  for (std::size_t r = 0; r + 1 < starts.size(); ++r)
    for (std::size_t begin = starts[r]; begin < starts[r + 1]; begin += length)
      blocks.push_back(sums_of(begin, std::min(begin + length, starts[r + 1])));
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
  const double freedom = std::max(1.0, static_cast<double>(blocks.size()) - 2);
  const auto estimate = [&](double value, double relative) {
    Estimate e;
    e.value = value;
    e.std = value * relative;
    e.low = value * std::exp(-student_95(freedom) * relative);
    e.high = value * std::exp(student_95(freedom) * relative);
    return e;
  };
  const double rate_std = std::sqrt(covariance(0, 0)), stall_std = std::sqrt(covariance(1, 1));
  if (!(stall_std <= kWorstStd)) {
    result.why_not =
        fmt::format("the speed falls by only {:.1f} %: the stall torque is known to {:.0f} %",
                    100 * result.largest_fall, std::min(100 * stall_std, 999.0));
    return result;
  }
  result.identifiable = true;
  result.rate = estimate(rate, rate_std);
  result.stall_torque = estimate(stall, stall_std);
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
