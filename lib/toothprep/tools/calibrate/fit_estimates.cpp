#include "toothprep/tools/calibrate/fit_estimates.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace toothprep {
namespace {

constexpr double kAlike = 0.8;  // correlation, from which delay and low-pass are alike

// Residuals are smaller than the noise by what the parameters took up: a tissue's own two and about
// as many of the sensor's.
double inflation(std::size_t blocks, int parameters) {
  const auto n = static_cast<double>(blocks);
  return n > parameters + 1 ? std::sqrt(n / (n - parameters)) : 3;
}

// Of exp(log_value), whose logarithm the draws change by `change`.
Estimate estimate(double log_value, const Eigen::VectorXd& change, std::size_t blocks) {
  const double raw = std::sqrt(change.squaredNorm() / static_cast<double>(change.size()));
  const double relative = raw * inflation(blocks, 4);
  const double t = student_95(std::max(1.0, static_cast<double>(blocks) - 2));
  Estimate e;
  e.value = std::exp(log_value);
  e.std = e.value * relative;
  e.low = e.value * std::exp(-t * relative);
  e.high = e.value * std::exp(t * relative);
  return e;
}

// What is reported: logarithms, and how the draws change them.
struct Reported {
  std::vector<std::string> names;
  std::vector<double> values;
  std::vector<Eigen::VectorXd> changes;

  void add(const std::string& name, double value, Eigen::VectorXd change) {
    names.push_back(name);
    values.push_back(value);
    changes.push_back(std::move(change));
  }
};

void describe_tissue(const Solution& solution, const BlockDraws& draws, const Blocks& blocks, int k,
                     TissueFit& t, Reported& reported) {
  const int pu = draws.free.shared[static_cast<std::size_t>(2 * k)];
  const int pw = draws.free.shared[static_cast<std::size_t>(2 * k + 1)];
  if (pw < 0) return;
  const std::size_t n = blocks.of_tissue[k];
  const Eigen::VectorXd w = draws.steps.row(pw);
  const double log_u = solution.state.shared[2 * k], log_w = solution.state.shared[2 * k + 1];
  const Estimate ratio = estimate(log_w, w, n);
  const bool little =
      t.why_not.reason == NotIdentifiable::kLittleForce || t.touched < kLeastTouched;
  if (ratio.std <= kWorstStd * ratio.value && !little) {
    t.ratio_identifiable = true;
    t.u_over_alpha = ratio;
  } else if (t.why_not.reason == NotIdentifiable::kNone) {
    t.why_not = {NotIdentifiable::kUncertain,
                 fmt::format("too little excitation (u/alpha to {:.0f} % only)",
                             100 * ratio.std / ratio.value)};
  }
  if (pu < 0) return;
  const Eigen::VectorXd u = draws.steps.row(pu);
  const Estimate energy = estimate(log_u, u, n), alpha = estimate(log_u - log_w, u - w, n);
  if (!t.ratio_identifiable || energy.std > kWorstStd * energy.value ||
      std::abs(log_u) >= kLargestLog) {
    if (t.why_not.reason == NotIdentifiable::kNone)
      t.why_not = {NotIdentifiable::kUncertain,
                   fmt::format("too little excitation to separate u and alpha (u to {:.0f} % only)",
                               100 * energy.std / energy.value)};
    return;
  }
  t.identifiable = true;
  t.u = energy;
  t.alpha = alpha;
  const std::string name(kTissueNames[k]);
  reported.add(name + ".u", log_u, u);
  reported.add(name + ".alpha", log_u - log_w, u - w);
}

}  // namespace

Blocks blocks_of(const Solution& solution, const FitOptions& o) {
  Blocks blocks;
  const FitData& data = solution.data;
  double longest = 0, duration = 0, step = 0;
  for (std::size_t r = 0; r < data.recordings.size(); ++r) {
    const ComparedRecording& rec = data.recordings[r];
    const auto modelled = modelled_force(rec, solution.state.own[r], solution.state);
    const double span = rec.time.back() - rec.time.front();
    const double own_step = span / static_cast<double>(rec.time.size() - 1);
    duration += span;
    step = std::max(step, own_step);
    for (int a = 0; a < 3; ++a) {
      std::vector<double> residual;
      residual.reserve(modelled.size());
      for (std::size_t j = 0; j < modelled.size(); ++j)
        if (data.contact[r][j]) residual.push_back(modelled[j][a] - rec.force[j][a]);
      longest = std::max(longest, correlation_time(residual, own_step));
    }
  }
  blocks.correlation_time = longest;
  blocks.length =
      o.block > 0 ? o.block : std::min(std::max(10 * longest, 20 * step), duration / 40);
  blocks.chunks = chunks_of(data.recordings, blocks.length);
  for (int k = 0; k < kTissueCount; ++k)
    for (const Chunk& c : blocks.chunks) {
      const ComparedRecording& rec = data.recordings[static_cast<std::size_t>(c.recording)];
      if (!rec.basis->touched(k)) continue;
      const auto first = static_cast<Eigen::Index>(basis_index(rec, c.begin, 0));
      const auto last = static_cast<Eigen::Index>(basis_index(rec, c.end - 1, 0));
      blocks.of_tissue[k] +=
          rec.columns(k).middleCols(first, last - first + 1).cwiseAbs().maxCoeff() > 0;
    }
  return blocks;
}

BlockDraws draw_blocks(const Solution& solution, const Asked& asked, const FitOptions& o) {
  const FitData& data = solution.data;
  const FreeSet set = free_set(solution.state, data.recordings.size(), asked);
  const auto sums = normal_sums(data.recordings, data.chunks, solution.state, Weighting::kSlope);
  return {set, block_bootstrap(sums, data.chunks, set, o.bootstrap, o.seed)};
}

void describe_sensor(const Solution& solution, const BlockDraws& draws, const Asked& asked,
                     FitResult& result) {
  const ModelState& state = solution.state;
  const FreeSet& set = draws.free;
  const Eigen::VectorXd deviation = (draws.steps.array().square().rowwise().mean()).sqrt();
  for (int i = 0; i < 3; ++i) {
    if (asked.rotation)
      result.rotation_std[i] = deviation[set.shared[static_cast<std::size_t>(kRotation + i)]];
    if (asked.weight)
      result.weight_std[i] = deviation[set.shared[static_cast<std::size_t>(kWeight + i)]];
    for (std::size_t r = 0; r < result.recordings.size(); ++r) {
      const auto& own = set.own[r];
      if (asked.bias)
        result.recordings[r].bias_std[i] = deviation[own[static_cast<std::size_t>(i)]];
      if (asked.drift)
        result.recordings[r].drift_std[i] = deviation[own[static_cast<std::size_t>(i + 3)]];
    }
  }
  result.rotation = state.shared.segment<3>(kRotation);
  result.weight = state.shared.segment<3>(kWeight);
  Estimate& delay = result.delay;
  delay.value = state.shared[kDelay];
  delay.std = asked.delay ? deviation[set.shared[kDelay]] : 0;
  delay.low = delay.value - 1.96 * delay.std;
  delay.high = delay.value + 1.96 * delay.std;
  Estimate& lowpass = result.lowpass;
  lowpass.value = solution.data.lowpass + state.shared[kLowpass];
  lowpass.std = asked.lowpass ? deviation[set.shared[kLowpass]] : 0;
  lowpass.low = std::max(0.0, lowpass.value - 1.96 * lowpass.std);
  lowpass.high = lowpass.value + 1.96 * lowpass.std;
  if (asked.lowpass && asked.delay) {
    const Eigen::VectorXd a = draws.steps.row(set.shared[kDelay]),
                          b = draws.steps.row(set.shared[kLowpass]);
    result.delay_lowpass_correlation = a.dot(b) / std::max(a.norm() * b.norm(), 1e-300);
    if (std::abs(result.delay_lowpass_correlation) > kAlike)
      result.warnings.push_back(fmt::format(
          "delay and low-pass look alike in these recordings (correlation {:.2f}): their sum, "
          "{:.2f} ms, is known better than either; sharp changes of the force separate them",
          result.delay_lowpass_correlation, 1e3 * (delay.value + lowpass.value)));
  }
  for (std::size_t r = 0; r < result.recordings.size(); ++r) {
    result.recordings[r].bias = state.own[r].head<3>();
    result.recordings[r].drift = state.own[r].tail<3>();
  }
}

void describe_shapes(const Solution& solution, const BlockDraws& draws, const Blocks& blocks,
                     FitResult& result) {
  const std::size_t n = blocks.chunks.size();
  const double t = student_95(std::max(1.0, static_cast<double>(n) - 2));
  for (int s = 0; s < solution.state.shapes; ++s) {
    const Eigen::VectorXd change =
        draws.steps.row(draws.free.shared[static_cast<std::size_t>(kShape + s)]);
    Estimate e;
    e.value = solution.state.shared[kShape + s];
    e.std = std::sqrt(change.squaredNorm() / static_cast<double>(change.size())) *
            inflation(n, 4 + solution.state.shapes);
    e.low = e.value - t * e.std;
    e.high = e.value + t * e.std;
    result.shapes.push_back(e);
  }
}

void describe_tissues(const Solution& solution, const BlockDraws& draws, const Blocks& blocks,
                      FitResult& result) {
  Reported reported;
  for (int k = 0; k < kTissueCount; ++k)
    describe_tissue(solution, draws, blocks, k, result.tissue[k], reported);
  result.names = reported.names;
  const auto n = static_cast<Eigen::Index>(reported.names.size());
  result.correlation = Eigen::MatrixXd::Identity(n, n);
  result.draws.resize(n, draws.steps.cols());
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto& a = reported.changes[static_cast<std::size_t>(i)];
    result.draws.row(i) =
        (a.array() + reported.values[static_cast<std::size_t>(i)]).exp().transpose();
    for (Eigen::Index j = 0; j < n; ++j) {
      const auto& b = reported.changes[static_cast<std::size_t>(j)];
      if (i != j) result.correlation(i, j) = a.dot(b) / std::max(a.norm() * b.norm(), 1e-300);
    }
  }
}

}  // namespace toothprep
