#include "toothprep/tools/calibrate/fit_modes.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/calibrate/fit_solver.h"

namespace toothprep {
namespace {

constexpr double kLeastShare = 1e-3;    // of the force: less of a tissue isn't modelled
constexpr double kAssumedNoise = 0.01;  // of the force: no sensor on a rig does better
constexpr double kUseless = 0.6;        // relative std: beyond, a parameter isn't even left free
constexpr double kSmallPart = 0.01;     // tangential by normal squares: they cancel
constexpr double kUnknown = 9.99;       // relative std of what isn't determined at all

// Squared length of the weighted columns of tissue k, tangential and normal, with u = w = 1.
struct ColumnSizes {
  double tangential = 0, normal = 0;
  bool cancel() const { return tangential < kSmallPart * normal; }
};
ColumnSizes column_sizes(const FitData& data, int k) {
  ColumnSizes sizes;
  for (const ComparedRecording& r : data.recordings)
    if (r.basis->touched(k)) {
      sizes.tangential += r.columns(k).topRows<3>().squaredNorm();
      sizes.normal += r.columns(k).bottomRows<3>().squaredNorm();
    }
  return sizes;
}

// Correlated noise counts as fewer samples: a sensor's noise is taken as white up to 100 Hz.
double samples_per_independent_one(const FitData& data) {
  double samples = 0, duration = 0;
  for (const ComparedRecording& r : data.recordings) {
    samples += static_cast<double>(r.time.size());
    duration += r.time.back() - r.time.front();
  }
  return std::max(1.0, samples / std::max(duration * 200, 1.0));
}

// Relative standard deviations of the tissues' parameters, with everything free that will be, so
// that what the delay or a rotation could explain isn't counted as known.
struct Deviations {
  std::array<double, kDelay> of{};  // 0: held
  ModelState here;                  // at the linear solution
  std::vector<double> singular_values;
};
Deviations deviations_at(const FitData& data, const ModelState& state, const Asked& asked) {
  Deviations result;
  const FreeSet linear_free = linear_set(state, data.recordings.size(), asked);
  const Linear linear = solve_linear(data, linear_free, state, data.stride, 5);
  result.here = state;
  for (int i = 0; i < kDelay; ++i)
    if (const int p = linear_free.shared[static_cast<std::size_t>(i)]; p >= 0)
      result.here.shared[i] = std::log(std::max(std::abs(linear.x[p]), 1e-12));
  const FreeSet set = free_set(state, data.recordings.size(), asked);
  ModelState plain = result.here;
  plain.loss = RobustLoss::kNone;
  const FreeSums total =
      total_of(normal_sums(data.recordings, data.chunks, plain, Weighting::kWeights, data.stride),
               data.chunks, set);
  Eigen::VectorXd scale = total.H.diagonal();
  for (double& s : scale) s = s > 0 ? 1 / std::sqrt(s) : 0;
  const Eigen::MatrixXd A = scale.asDiagonal() * total.H * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(A);
  for (Eigen::Index i = eigen.eigenvalues().size(); i-- > 0;)
    result.singular_values.push_back(std::sqrt(std::max(0.0, eigen.eigenvalues()[i])));
  // Inverse with a floor, so that what isn't determined at all has a huge deviation.
  const Eigen::VectorXd inverse = eigen.eigenvalues().cwiseMax(1e-12).cwiseInverse();
  const double sigma = data.recordings.front().sigma;
  const double noise =
      std::max(sigma, kAssumedNoise * data.force_rms) / sigma *
      std::sqrt(samples_per_independent_one(data) * static_cast<double>(data.stride));
  for (std::size_t i = 0; i < kDelay; ++i) {
    const int p = set.shared[i];
    if (p < 0) continue;
    const Eigen::VectorXd row = eigen.eigenvectors().row(p);
    const bool found = linear.x[linear_free.shared[i]] > 0 && scale[p] != 0;
    result.of[i] = found ? noise * scale[p] * std::sqrt(row.cwiseAbs2().dot(inverse)) : kUnknown;
  }
  return result;
}

// The worst parameter goes first; what it did to the others shows in the next pass. One that is
// merely uncertain stays free, so that it doesn't pull the others; the uncertainty in the end says
// what is reported.
struct Worst {
  int parameter = -1;
  double deviation = 0;
};
Worst worst_of(const Deviations& deviations, const FitData& data) {
  Worst worst;
  for (std::size_t i = 0; i < kDelay; ++i) {
    const double d = deviations.of[i];
    if (d == 0 || (i % 2 == 1 && deviations.of[i - 1] > 0)) continue;
    const bool cancels = i % 2 == 0 && column_sizes(data, static_cast<int>(i / 2)).cancel();
    if (d > (cancels ? kWorstStd / 5 : kUseless) && d > worst.deviation)
      worst = {static_cast<int>(i), d};
  }
  return worst;
}

WhyNot why_tied(const ColumnSizes& size, const Asked& asked, double deviation, double touched) {
  if (size.cancel())
    return {NotIdentifiable::kOnlyPlunge,
            fmt::format("only plunge: the tangential forces around the bur cancel ({:.1f} % of the "
                        "normal part), so u and alpha can't be separated; feed sideways too",
                        100 * std::sqrt(size.tangential / size.normal))};
  if (asked.rotation)
    return {NotIdentifiable::kLikeRotation,
            "u and alpha can't be separated from the sensor's rotation: feed sideways and plunge, "
            "or give the rotation"};
  return {NotIdentifiable::kNotSeparable,
          fmt::format("too little excitation to separate u and alpha (u to about {:.0f} %; touched "
                      "{:.2f} s)",
                      100 * std::min(deviation, kUnknown), touched)};
}

// Little force altogether. The tissue stays in the model if it makes any: whether it does.
bool makes_force(const FitData& data, const Deviations& deviations, const Worst& worst) {
  const double share = std::exp(2 * deviations.here.shared[worst.parameter]) *
                       column_sizes(data, worst.parameter / 2).normal;
  double all = 0;
  for (const ComparedRecording& r : data.recordings)
    all += data.force_rms * data.force_rms * static_cast<double>(r.basis->size);
  return share >= kLeastShare * all && worst.deviation < kUnknown;
}

void throw_if_none(const FitModes& modes, const FitStart& start) {
  std::string why;
  for (int k = 0; k < kTissueCount; ++k) {
    if (modes.state.mode[k] != start.data.aside()) return;
    if (start.touched[k] > 0)
      why +=
          (why.empty() ? "" : "; ") + std::string(kTissueNames[k]) + ": " + modes.why_not[k].text;
  }
  throw Error("no parameter is identifiable from these recordings (" + why + ")");
}

}  // namespace

FitModes choose_modes(const FitStart& start, const FitOptions& o) {
  const FitData& data = start.data;
  FitModes modes{start.state, {}, {}};
  for (int k = 0; k < kTissueCount; ++k) {
    if (start.touched[k] == 0)
      modes.why_not[k] = {NotIdentifiable::kNeverTouched, "never touched"};
    else if (modes.state.mode[k] == TissueMode::kTied)
      modes.why_not[k] = {NotIdentifiable::kHardlyTouched,
                          fmt::format("touched for only {:.3f} s", start.touched[k])};
  }
  for (int pass = 0; pass <= 2 * kTissueCount; ++pass) {
    if (linear_set(modes.state, data.recordings.size(), start.asked).size == 0)
      break;  // every tissue is set aside
    const Deviations deviations = deviations_at(data, modes.state, start.asked);
    modes.singular_values = deviations.singular_values;
    const Worst worst = worst_of(deviations, data);
    if (worst.parameter < 0) break;
    const int k = worst.parameter / 2;
    if (worst.parameter % 2 == 0) {
      modes.state.mode[k] = TissueMode::kTied;
      modes.why_not[k] =
          why_tied(column_sizes(data, k), start.asked, worst.deviation, start.touched[k]);
      continue;
    }
    if (modes.why_not[k].reason == NotIdentifiable::kNone || start.touched[k] >= kLeastTouched)
      modes.why_not[k] = {
          NotIdentifiable::kLittleForce,
          fmt::format("too little excitation (touched {:.2f} s; u/alpha to about {:.0f} %)",
                      start.touched[k], 100 * std::min(worst.deviation, kUnknown))};
    if (makes_force(data, deviations, worst)) break;  // modelled, not reported
    modes.state.mode[k] = data.aside();
    modes.state.shared[2 * k] = std::log(std::max(o.start[k].specific_energy, 1e-3));
    modes.state.shared[2 * k + 1] = modes.state.shared[2 * k] - std::log(o.start[k].force_ratio);
  }
  throw_if_none(modes, start);
  return modes;
}

}  // namespace toothprep
