#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "experiment.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/calibrate/lowpass.h"
#include "toothprep/tools/trajectory/smoothing.h"

namespace toothprep::testing {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;

// A ramp comes through a first-order low-pass with its own slope, late by the time constant.
TEST(Lowpass, RampIsLateByTheTimeConstantForAnyStep) {
  for (const double tau : {1e-4, 1e-3, 0.02}) {
    const LowpassStep a = lowpass_step(tau, 1e-3);
    EXPECT_NEAR(a.keep + a.before + a.now, 1, 1e-15);
    double y = 0, x = 0;
    for (int i = 1; i <= 1000; ++i) {
      const double next = i * 1e-3;
      y = a.keep * y + a.before * x + a.now * next;
      x = next;
    }
    EXPECT_NEAR(x - y, tau, 1e-12);
  }
}

TEST(Lowpass, TimeConstantAndDelayAreFoundTogether) {
  for (const double tau : {0.004, 0.016}) {
    SensorOptions s;
    s.noise = 0.02;
    s.delay = 0.003;
    s.lowpass_hz = 1 / (2 * units::kPi * tau);
    FitOptions o;
    o.estimate_delay = o.estimate_lowpass = true;
    o.largest_delay = 0.02;
    o.diagnose = false;
    const FitResult r = fit_to(mixed_feed(), mixed_basis(), s, o);
    std::printf("[ lowpass  ] tau %.3f +- %.3f of %.0f ms, delay %.3f +- %.3f of 3 ms, corr %.2f\n",
                1e3 * r.lowpass.value, 1e3 * r.lowpass.std, 1e3 * tau, 1e3 * r.delay.value,
                1e3 * r.delay.std, r.delay_lowpass_correlation);
    EXPECT_NEAR(r.lowpass.value, tau, std::max(4 * r.lowpass.std, 2e-4));
    EXPECT_NEAR(r.delay.value, 0.003, std::max(4 * r.delay.std, 2e-4));
    EXPECT_LT(r.lowpass.std, 0.2 * tau);
    EXPECT_LT(r.delay_lowpass_correlation, -0.3);  // one takes up what the other leaves
    expect_truth(r, 0.01);
  }
}

TEST(Lowpass, NoneIsFoundWhereThereIsNone) {
  SensorOptions s;
  s.noise = 0.02;
  FitOptions o;
  o.estimate_lowpass = true;
  o.diagnose = false;
  const FitResult r = fit_to(mixed_feed(), mixed_basis(), s, o);
  EXPECT_LT(r.lowpass.value, 1e-3);
  expect_truth(r, 0.01);
}

TEST(Weight, OfABurThatNeverTurnsIsNotIdentifiable) {
  FitOptions o;
  o.on_handpiece = o.estimate_weight = true;
  SensorOptions s;
  s.noise = 0.02;
  const auto path = mixed_feed();
  std::vector<Vec3> force = true_force(mixed_basis());
  for (std::size_t i = 0; i < force.size(); ++i)
    force[i] = path[i].pose.orientation.conjugate() * force[i];
  const MeasuredRecording r = recorded(path, measured_by(s, force, mixed_basis().step));
  const FitResult fitted = fit({compare(r, mixed_basis(), o.largest_delay, 0, true)}, o);
  EXPECT_THAT(fitted.weight_why_not, HasSubstr("never turned"));
  EXPECT_THAT(fitted.warnings, Contains(HasSubstr("handpiece weight not identifiable")));
  expect_truth(fitted, 0.02);
  o.bias = Vec3(Vec3::Zero());  // with a known bias, what is left is the weight
  const FitResult known = fit({compare(r, mixed_basis(), o.largest_delay, 0, true)}, o);
  EXPECT_TRUE(known.weight_why_not.empty());
  EXPECT_LT(known.weight.norm(), 0.02);
}

TEST(Unit, GramsAreSeenAgainstTheModelEvenWhereTheyLookLikeNewtons) {
  // A light touch: a hundredth of the usual feed makes forces of grams.
  auto force = true_force(mixed_basis());
  const double newton = contact_rms(force);
  for (Vec3& f : force) f *= 100;
  MeasuredRecording r = recorded(mixed_feed(), force);
  EXPECT_NEAR(force_by_plausible(r, mixed_basis()) / 100, newton / contact_rms([] {
                                                            PerTissue<GrindingProperties> t;
                                                            for (int k = 0; k < kTissueCount; ++k)
                                                              t[k] = {k == 0 ? 300.0 : 100.0, 0.3};
                                                            return true_force(mixed_basis(), t);
                                                          }()),
              0.02);
  try {
    check_unit_by_model(r, mixed_basis(), {});
    FAIL();
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("grams"));
  }
  for (Vec3& f : r.motion.measured_force) f *= 10;
  try {
    check_unit_by_model(r, mixed_basis(), {});
    FAIL();
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("millinewtons"));
  }
  ForceReading stated;
  stated.unit_stated = true;
  check_unit_by_model(r, mixed_basis(), stated);
  for (Vec3& f : r.motion.measured_force) f *= 0.01;  // ten times what was: hard tissue
  check_unit_by_model(r, mixed_basis(), {});
}

// A quadratic is kept exactly; white noise of the velocity falls with n^1.5.
TEST(Motion, SmoothingKeepsAQuadraticAndLowersTheVelocitysNoise) {
  std::vector<HandleSample> path(2001);
  for (std::size_t i = 0; i < path.size(); ++i) {
    const double t = static_cast<double>(i) * 1e-3;
    path[i].time = t;
    path[i].pose.position = Vec3(0.3 * t, -0.2 * t * t, 1);
  }
  const auto same = smoothed(path, 0.041);
  for (std::size_t i = 0; i < path.size(); ++i)
    EXPECT_LT((same[i].pose.position - path[i].pose.position).norm(), 1e-13);
  EXPECT_LT(velocity_noise(path).noise, 0.05 * velocity_noise(path).feed);
  SensorOptions s;
  s.position_noise = 0.005;
  std::vector<StepRecord> rows(path.size());
  for (std::size_t i = 0; i < path.size(); ++i) rows[i].bur.position = path[i].pose.position;
  disturb_motion_and_speed(s, rows);
  auto noisy = path;
  for (std::size_t i = 0; i < path.size(); ++i) noisy[i].pose.position = rows[i].bur.position;
  const VelocityNoise before = velocity_noise(noisy),
                      after = velocity_noise(smoothed(noisy, 0.041));
  // Differences of white noise: sqrt(2) sigma / step on each of three axes.
  EXPECT_NEAR(before.noise, std::sqrt(6.0) * 0.005 / 1e-3, 0.05 * before.noise);
  // Of white noise the window's weights w leave sqrt(sum of (w_i - w_i+1)^2), the differences of
  // what an impulse becomes; without smoothing sqrt(2). The mean over 50 ms takes some of it away.
  std::vector<Vec3> impulse(101, Vec3::Zero());
  impulse[50].x() = 1;
  impulse = smoothed(impulse, 20);
  double square = 0;
  for (std::size_t i = 1; i < impulse.size(); ++i)
    square += (impulse[i] - impulse[i - 1]).squaredNorm();
  EXPECT_LT(after.noise, 1.1 * before.noise * std::sqrt(square / 2));
  EXPECT_GT(after.noise, before.noise * std::sqrt(square / 2) / 3);
}

// 5 um of noise on positions at 1 kHz are 12 mm/s in the velocity, ten times the feed: without
// smoothing the force is not to be recognised.
TEST(Motion, SmoothingRescuesNoisyPositions) {
  SensorOptions s;
  s.noise = 0.02;
  s.position_noise = 0.005;
  const std::vector<Vec3> measured = measured_by(s, true_force(mixed_basis()), 1e-3);
  auto path = mixed_feed();
  std::vector<StepRecord> rows(path.size());
  for (std::size_t i = 0; i < path.size(); ++i) rows[i].bur.position = path[i].pose.position;
  disturb_motion_and_speed(s, rows);
  for (std::size_t i = 0; i < path.size(); ++i) path[i].pose.position = rows[i].bur.position;
  const auto error_with = [&](double window) {
    const auto smooth = smoothed(path, window);
    const ForceBasis basis =
        force_basis(cylinder(), block_with(1.0), preset_parameters("paper"), smooth);
    FitOptions o;
    o.diagnose = false;
    const FitResult r = fit({compare(recorded(smooth, measured), basis, 0.05, 0, false)}, o);
    std::printf("[ smooth   ] %3.0f ms: enamel u %.3f alpha %.3f of the truth (R2 %.3f)\n",
                1e3 * window, r.tissue[0].u.value / truth()[0].specific_energy,
                r.tissue[0].alpha.value / truth()[0].force_ratio, r.residual_r2);
    return r.tissue[0].identifiable ? std::abs(r.tissue[0].u.value / truth()[0].specific_energy - 1)
                                    : 9.0;
  };
  const double rough = error_with(0), smooth = error_with(0.1);
  EXPECT_GT(rough, 0.2);
  EXPECT_LT(smooth, 0.05);
}

}  // namespace
}  // namespace toothprep::testing
