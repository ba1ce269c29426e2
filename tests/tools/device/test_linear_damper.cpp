// The reference case: 45 g, 0.05 N·s/m, 0.06 N, 0.023 mm, 1 kHz, 7.9 N, pulled at 0.5 mm/s by a
// hand of 300 N/m and 2 N·s/m without mass. Phases are where within a count the handle starts.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "toothprep/tools/device/linear_damper_loop.h"

namespace toothprep {
namespace {

LinearDamperExperiment reference(Rendering rendering, double damping_N_s_m, double phase = 0) {
  LinearDamperExperiment e;
  e.hand.mass = 0;
  e.rendering = rendering;
  e.damping = damping_N_s_m * 1e-3;
  e.start.x() = phase * e.phantom.encoder_count;
  return e;
}

constexpr double kPhases[] = {0, 0.25, 0.5, 0.75};

TEST(LinearDamperDirect, FiveIsStableWithOnePulsePerCount) {
  for (const double damping : {1.0, 2.0, 5.0})
    for (const double phase : kPhases) {
      const auto e = reference(Rendering::kDirect, damping, phase);
      const ClosedLoopFigures f = run_linear_damper(e).figures;
      EXPECT_EQ(f.verdict, LoopVerdict::kStable) << damping;
      EXPECT_EQ(f.backward_fraction, 0) << damping;
      // Never two counts in one tick, never one back: B D/T, which is 0.046 N for 2 N·s/m.
      EXPECT_NEAR(f.force_peak_to_peak, e.damping * 0.023 / 1e-3, 1e-9);
      // Pulses of B D/T, v T/D = 1/46 of the ticks: RMS about B D/T sqrt(1/46) less what is below
      // 20 Hz of the pulses' 22 Hz: little but their mean.
      EXPECT_NEAR(f.force_rms_above_20, e.damping * 23 * std::sqrt(1 / 46.0), 0.1 * e.damping * 23);
    }
}

TEST(LinearDamperDirect, FromTenOnItVibrates) {
  // One count forward, one back: 2 B D/T from peak to peak. Backward fractions of an independent
  // simulation of the same equations: 0.04, 0.11, 0.28; the stick of friction and the phase account
  // for the rest (here 0.043-0.044, 0.085-0.088, 0.229-0.237).
  const double damping[] = {10, 20, 60}, backward[] = {0.04, 0.11, 0.28};
  for (int i = 0; i < 3; ++i)
    for (const double phase : kPhases) {
      const auto e = reference(Rendering::kDirect, damping[i], phase);
      const ClosedLoopFigures f = run_linear_damper(e).figures;
      EXPECT_EQ(f.verdict, LoopVerdict::kVibrates);
      EXPECT_NEAR(f.force_peak_to_peak, 2 * e.damping * 0.023 / 1e-3, 1e-9);
      EXPECT_NEAR(f.backward_fraction, backward[i], 0.02 + 0.15 * backward[i]);
      EXPECT_EQ(f.saturated_fraction, 0);
    }
}

TEST(LinearDamperDirect, AHundredIsUnstable) {
  for (const double phase : kPhases) {
    const ClosedLoopFigures f =
        run_linear_damper(reference(Rendering::kDirect, 100, phase)).figures;
    EXPECT_EQ(f.verdict, LoopVerdict::kUnstable);
    EXPECT_NEAR(f.force_peak_to_peak, 15.8, 1e-9);  // +-7.9 N
    EXPECT_NEAR(f.backward_fraction, 0.5, 0.05);
    EXPECT_GT(f.saturated_fraction, 0.4);
  }
}

TEST(LinearDamperDirect, GrindingSizedResistanceIsHopeless) {
  // 4 N·s/mm: a count is 92 N.
  const ClosedLoopFigures f = run_linear_damper(reference(Rendering::kDirect, 4000)).figures;
  EXPECT_EQ(f.verdict, LoopVerdict::kUnstable);
  EXPECT_NEAR(f.force_rms_above_20, 7.9, 0.1);
}

TEST(LinearDamperCoupled, ItIsQuietUpToNineThousand) {
  for (const double damping : {10.0, 100.0, 1000.0, 4000.0, 9000.0})
    for (const double phase : kPhases) {
      const ClosedLoopFigures f =
          run_linear_damper(reference(Rendering::kCoupled, damping, phase)).figures;
      EXPECT_EQ(f.verdict, LoopVerdict::kStable) << damping;
      EXPECT_EQ(f.backward_fraction, 0) << damping;
      // A count is a step of k D = 0.023 N: an even ramp over it has an RMS of kD/sqrt(12).
      EXPECT_LT(f.force_rms_above_20, 0.023 / std::sqrt(12.0)) << damping;
    }
}

TEST(LinearDamperCoupled, TheForceChangesByTheSlowRiseAndACountAtMost) {
  // The handle breaks away when the hand's spring holds f_c: t0 = (0.06 - 0.001)/0.15 s. From then
  // on F = B v (1 - exp(-(t - t0) k'/B)) with hand and coupling in series, k' = 1 * 0.3/1.3 N/mm;
  // figures are of 0.5 to 2 s. Counts add up to k D = 0.023 N. An independent simulation gave 0.13
  // and 0.16 N.
  const double t0 = 0.059 / 0.15, series = 0.3 / 1.3;
  for (const double damping : {1000.0, 4000.0})
    for (const double phase : kPhases) {
      const double b = damping * 1e-3;
      const double rise =
          0.5 * b * (std::exp(-(0.5 - t0) * series / b) - std::exp(-(2 - t0) * series / b));
      const double measured = run_linear_damper(reference(Rendering::kCoupled, damping, phase))
                                  .figures.force_peak_to_peak;
      EXPECT_GT(measured, rise - 0.5 * 0.023);
      EXPECT_LT(measured, rise + 1.5 * 0.023);
    }
  // At 10 N·s/m the force stays within the steps of single counts.
  EXPECT_LT(run_linear_damper(reference(Rendering::kCoupled, 10)).figures.force_peak_to_peak,
            0.0231);
}

TEST(LinearDamperCoupled, TheStepResponseHasTheTimeConstantOfDamperOverSpring) {
  // Handle moved at v from rest: F(t) = B v (1 - exp(-k t/B)); B = 4 N·s/mm: 63 % of 2 N at 4 s.
  // Backward Euler errs by h k/(2B), the inertia by m/B: both below 1e-3.
  const double h = 1e-3;
  LinearDamper render(Rendering::kCoupled, 4, h, Coupling{}, Vec3::Zero());
  double reached_63 = 0, largest = 0;
  for (int n = 1; n <= 20000; ++n) {
    const double t = n * h;
    const double felt = -render(static_cast<std::size_t>(n), Vec3(0, 0.5 * t, 0)).y();
    largest = std::max(largest, std::abs(felt - 2 * (1 - std::exp(-t / 4))));
    if (reached_63 == 0 && felt >= 2 * (1 - std::exp(-1.0))) reached_63 = t;
  }
  EXPECT_NEAR(reached_63, 4, 0.01 * 4);
  EXPECT_LT(largest, 0.001 * 2);
}

TEST(LinearDamperCoupled, WithoutCountsAndFrictionTheWholeLoopFollowsTheClosedForm) {
  // As above, hand and coupling in series; the hand's damper and the masses delay by milliseconds.
  auto e = reference(Rendering::kCoupled, 1000);
  e.phantom.friction = 0;
  e.phantom.encoder_count = 0;
  e.phantom.sub_steps = 10;
  e.duration = 10;
  const ClosedLoopSeries s = run_linear_damper(e).series;
  const double series = 0.3 / 1.3;
  for (std::size_t n = 0; n < s.time.size(); n += 100)
    EXPECT_NEAR(-s.force[n].x(), 0.5 * (1 - std::exp(-s.time[n] * series)), 0.01 * 0.5);
}

TEST(LinearDamper, CouplingTakesTheVibrationAway) {
  // At 20 N·s/m both transmit 0.01 N on average.
  const double direct =
      run_linear_damper(reference(Rendering::kDirect, 20)).figures.force_rms_above_20;
  const double coupled =
      run_linear_damper(reference(Rendering::kCoupled, 20)).figures.force_rms_above_20;
  EXPECT_GT(direct, 20 * coupled);
}

TEST(LinearDamper, TheSameRunHasTheSameBits) {
  for (const Rendering rendering : {Rendering::kDirect, Rendering::kCoupled}) {
    const auto a = run_linear_damper(reference(rendering, 20));
    const auto b = run_linear_damper(reference(rendering, 20));
    ASSERT_EQ(a.series.position.size(), b.series.position.size());
    for (std::size_t n = 0; n < a.series.position.size(); ++n) {
      ASSERT_EQ(std::memcmp(a.series.position[n].data(), b.series.position[n].data(), 24), 0);
      ASSERT_EQ(std::memcmp(a.series.force[n].data(), b.series.force[n].data(), 24), 0);
    }
    EXPECT_EQ(a.figures.force_rms_above_20, b.figures.force_rms_above_20);
  }
}

TEST(LinearDamper, TheVerdictDoesNotHangOnTheSubStep) {
  for (const double damping : {5.0, 10.0, 100.0}) {
    auto e = reference(Rendering::kDirect, damping);
    const LoopVerdict usual = run_linear_damper(e).figures.verdict;
    for (const int sub_steps : {5, 20, 200}) {
      e.phantom.sub_steps = sub_steps;
      EXPECT_EQ(run_linear_damper(e).figures.verdict, usual) << damping << ", " << sub_steps;
    }
  }
}

TEST(LinearDamper, NonsenseIsRefused) {
  const auto refused = [](auto spoil) {
    auto e = reference(Rendering::kCoupled, 100);
    e.duration = 1;
    spoil(e);
    EXPECT_THROW(run_linear_damper(e), Error);
  };
  refused([](auto& e) { e.damping = -1; });
  refused([](auto& e) { e.damping = std::numeric_limits<double>::quiet_NaN(); });
  refused([](auto& e) { e.speed = 0; });
  refused([](auto& e) { e.duration = 1e9; });
  refused([](auto& e) { e.settling = 1; });
  refused([](auto& e) { e.coupling.stiffness = 0; });
  refused([](auto& e) { e.coupling.bur_mass = -1; });
  refused([](auto& e) { e.coupling.damping = -1; });
  refused([](auto& e) { e.phantom.rate = 0; });
  refused([](auto& e) { e.hand.damping = -1; });
}

}  // namespace
}  // namespace toothprep
