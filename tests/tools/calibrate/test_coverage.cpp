#include <gtest/gtest.h>
#include <tbb/parallel_for.h>

#include "experiment.h"

namespace toothprep::testing {
namespace {

// The stated 95 % intervals hold the truth in 90 to 98 % of 200 trials: with 200, a true coverage
// of 95 % scatters by 1.5 % (one standard deviation). The noise is correlated over 8 ms, which an
// uncertainty for independent samples would understate by a factor of four.
TEST(Coverage, IntervalsHoldTheTruthInNinetyToNinetyEightPercent) {
  const auto path = legs({-3.6, -0.9, -1.0},
                         {{{0.0, -0.9, -1.0}, 2.0},
                          {{0.0, -2.0, -1.0}, 1.0},
                          {{-2.0, -2.0, -1.0}, 2.0},
                          {{-1.4, -2.0, 0.6}, 2.0},
                          {{-1.4, 0.4, 0.6}, 6.0}},
                         400);
  Parameters p = preset_parameters("paper");
  p.time_step = 0.0025;
  const ForceBasis basis = force_basis(cylinder(), block_with(1.0), p, path);
  const std::vector<Vec3> force = true_force(basis);
  constexpr int kTrials = 200;
  std::array<std::array<char, 6>, kTrials> held{};
  std::array<std::array<double, 6>, kTrials> ratio{}, stated{};
  tbb::parallel_for(0, kTrials, [&](int trial) {
    SensorOptions s;
    s.noise = 0.05;
    s.noise_correlation = 0.008;
    s.bias = Vec3(0.1, -0.05, 0.02);
    s.delay = 0.003;
    s.outliers = 0.01;
    s.seed = 1000 + static_cast<std::uint64_t>(trial);
    FitOptions o;
    o.estimate_delay = true;
    o.largest_delay = 0.02;
    o.bootstrap = 400;
    o.diagnose = false;
    o.seed = static_cast<std::uint64_t>(trial);
    const MeasuredRecording r = recorded(path, measured_by(s, force, basis.step));
    const FitResult fitted = fit({compare(r, basis, o.largest_delay, 0, false)}, o);
    const auto t = static_cast<std::size_t>(trial);
    for (std::size_t k = 0; k < 2; ++k) {
      const TissueFit& tissue = fitted.tissue[k];
      const double u = truth()[k].specific_energy, alpha = truth()[k].force_ratio;
      const std::pair<const Estimate*, double> pairs[] = {
          {&tissue.u, u}, {&tissue.alpha, alpha}, {&tissue.u_over_alpha, u / alpha}};
      for (std::size_t i = 0; i < 3; ++i) {
        const auto& [e, true_value] = pairs[i];
        held[t][3 * k + i] = e->low <= true_value && true_value <= e->high;
        ratio[t][3 * k + i] = e->value / true_value - 1;
        stated[t][3 * k + i] = e->std / true_value;
      }
    }
  });
  std::printf(
      "%.1f s at 400 Hz, 5 %% noise correlated over 8 ms, bias, 3 ms delay, 1 %% outliers\n",
      basis.step * static_cast<double>(basis.size));
  std::printf("parameter        in the 95 %% interval   mean error   scatter   stated (median)\n");
  const char* names[] = {"enamel u", "enamel alpha", "enamel u/alpha",
                         "dentin u", "dentin alpha", "dentin u/alpha"};
  for (std::size_t i = 0; i < 6; ++i) {
    int count = 0;
    double mean = 0, square = 0;
    std::vector<double> deviations;
    for (std::size_t t = 0; t < kTrials; ++t) {
      count += held[t][i];
      mean += ratio[t][i] / kTrials;
      square += ratio[t][i] * ratio[t][i] / kTrials;
      deviations.push_back(stated[t][i]);
    }
    std::nth_element(deviations.begin(), deviations.begin() + kTrials / 2, deviations.end());
    const double percent = 100.0 * count / kTrials;
    std::printf("%-15s %12.1f %%          %+8.3f %%  %7.3f %%  %7.3f %%\n", names[i], percent,
                100 * mean, 100 * std::sqrt(square), 100 * deviations[kTrials / 2]);
    EXPECT_GE(percent, 90) << names[i];
    EXPECT_LE(percent, 98) << names[i];
  }
}

}  // namespace
}  // namespace toothprep::testing
