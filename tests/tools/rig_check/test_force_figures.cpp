#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "made_recording.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/rig_check/rig_figures.h"

namespace toothprep {
namespace {

using testing::kPeriod;
using testing::made_recording;

const RigMethod kMethod;

const EventFigures& event(const std::vector<EventFigures>& all, const std::string& name) {
  for (const EventFigures& e : all)
    if (e.name == name) return e;
  throw std::runtime_error("no event " + name);
}

TEST(ForceEvents, ClippingIsCountedAsItWasMade) {
  SessionRecording r = made_recording(1000);
  for (const auto& [from, ticks] : {std::pair<std::size_t, std::size_t>(0, 5), {100, 30}, {999, 1}})
    for (std::size_t i = 0; i < ticks; ++i) r.flags[from + i] |= kForceClamped;
  for (std::size_t i = 200; i < 220; ++i) r.flags[i] |= kForceRateLimited | kForceHeatLimited;
  const auto all = force_events(r);
  ASSERT_EQ(all.size(), 7u);
  EXPECT_EQ(event(all, "clamped").ticks, 36);
  EXPECT_EQ(event(all, "clamped").events, 3);
  EXPECT_DOUBLE_EQ(event(all, "clamped").share, 0.036);
  EXPECT_NEAR(event(all, "clamped").longest, 0.030, 1e-12);
  EXPECT_EQ(event(all, "rate_limited").ticks, 20);
  EXPECT_EQ(event(all, "heat_limited").events, 1);
  EXPECT_EQ(event(all, "not_finite").ticks, 0);
  EXPECT_EQ(event(all, "withheld").events, 0);
}

TEST(FaultEvents, AreToldByNameOnsetAndSeverity) {
  SessionRecording r = made_recording(100);
  for (const std::size_t i : {10, 11, 12, 40})
    r.fault[i] = static_cast<std::uint32_t>(DeviceFault::kWarmMotors);
  r.fault[99] = static_cast<std::uint32_t>(DeviceFault::kUnplugged);
  const auto faults = fault_events(r);
  ASSERT_EQ(faults.size(), 2u);
  EXPECT_EQ(faults[0].name, "warm_motors");
  EXPECT_EQ(faults[0].ticks, 4);
  EXPECT_EQ(faults[0].onsets, 2);
  EXPECT_FALSE(faults[0].final);
  EXPECT_DOUBLE_EQ(faults[0].first, 0.010);
  EXPECT_EQ(faults[1].name, "unplugged");
  EXPECT_TRUE(faults[1].final);
}

// A handle that swings x_n = A sin(2 pi n/N), N ticks a cycle, and a law that answers x_n with f_n,
// held to the next tick: row n + 1 has f_n.
constexpr double kAmplitude = 5;  // mm
constexpr int kCycle = 500;       // ticks: 2 Hz
SessionRecording swinging(int cycles, const std::function<double(double x, double dx)>& law) {
  const auto n = static_cast<std::size_t>(cycles * kCycle) + 1;
  SessionRecording r = made_recording(n + 1);
  const auto x = [](double i) { return kAmplitude * std::sin(2 * units::kPi * i / kCycle); };
  for (std::size_t i = 0; i <= n; ++i) {
    const auto k = static_cast<double>(i);
    r.device_position[i] = Vec3(0, x(k), 0);
    r.force_commanded[i] = Vec3(0, law(x(k), x(k) - x(k - 1)), 0);
    if (i > 0) r.force_sent[i] = r.force_commanded[i - 1];
  }
  return r;
}
// Sum over a cycle of dx_n dx_n+1, dx_n = x_n - x_n-1 = 2 A sin(pi/N) cos(2 pi (n - 1/2)/N).
double sum_of_products() {
  const double step = 2 * kAmplitude * std::sin(units::kPi / kCycle);
  return kCycle / 2.0 * step * step * std::cos(2 * units::kPi / kCycle);
}

// f = -c dx/T takes c/T sum dx_n dx_n+1 a cycle; with the sign turned it gives as much. The last
// row of the recording adds a part of a cycle: one step, c/T dx².
TEST(DevicePort, ADamperTakesAndANegativeOneGivesTheWorkOfTheClosedForm) {
  constexpr double kDamping = 2e-3;  // N·s/mm
  const double cycle = kDamping / kPeriod * sum_of_products();
  const double step = 2 * kAmplitude * std::sin(units::kPi / kCycle);
  const double last = kDamping / kPeriod * step * step;
  const auto damper =
      device_port_figures(swinging(4, [&](double, double dx) { return -kDamping / kPeriod * dx; }));
  ASSERT_TRUE(damper);
  EXPECT_NEAR(damper->last, 4 * cycle, 1.01 * last);
  EXPECT_EQ(damper->minimum, 0);
  // A sampled damper gives back a little only where the motion turns: half a tick late.
  EXPECT_LT(damper->largest_return, 1e-3 * cycle);

  const auto active =
      device_port_figures(swinging(4, [&](double, double dx) { return kDamping / kPeriod * dx; }));
  ASSERT_TRUE(active);
  EXPECT_NEAR(active->minimum, -4 * cycle, 1.01 * last);
  EXPECT_NEAR(active->minimum_at, 4 * kCycle * kPeriod, 3 * kPeriod);
}

// A sampled and held spring is not passive: E = k (x_N² - x_0²)/2 - k/2 sum dx², so it leaks
// k/2 sum dx² each cycle, which is a damping of -k T/2 (Colgate and Schenkel's condition).
TEST(DevicePort, ASampledSpringLeaksHalfATickOfNegativeDamping) {
  constexpr double kStiffness = 1;  // N/mm
  const auto f =
      device_port_figures(swinging(10, [&](double x, double) { return -kStiffness * x; }));
  ASSERT_TRUE(f);
  const double step = 2 * kAmplitude * std::sin(units::kPi / kCycle);
  const double leak = kStiffness / 2 * kCycle / 2.0 * step * step;  // per cycle
  // Row 10 * kCycle is a whole number of cycles, where x² = 0.
  EXPECT_NEAR(f->energy[10 * kCycle], -10 * leak, 1e-9);
  // What came back is what was stored, and the leak.
  const double stored = kStiffness * kAmplitude * kAmplitude / 2;
  EXPECT_GT(f->largest_return, stored);
  EXPECT_LT(f->largest_return, stored + 11 * leak);
}

// The same in closed form: what it leaks is all that sampling explains, so that nothing is left at
// whole cycles, where the spring is slack again.
TEST(DevicePort, ASampledSpringIsExplainedToTheLastBit) {
  constexpr double kStiffness = 1;
  const PortSpring spring{kStiffness, 0, 0};
  const auto f =
      device_port_figures(swinging(10, [&](double x, double) { return -kStiffness * x; }), spring);
  ASSERT_TRUE(f);
  EXPECT_LT(f->minimum, -0.2);
  EXPECT_GT(f->unexplained_minimum, -1e-9);
  EXPECT_NEAR(f->store, kStiffness * kAmplitude * kAmplitude / 2, 1e-9);
  EXPECT_NEAR(f->unexplained_return, f->store, 1e-9);
}

// A spring that pushes back with more than it was pressed with, and one that answers late: with a
// delay of d ticks it leaks (d + 1/2) k sum dx².
TEST(DevicePort, AnActiveSpringIsNotExplained) {
  const PortSpring spring{1, 0, 0};
  const auto stronger = device_port_figures(
      swinging(4, [](double x, double dx) { return x * dx > 0 ? -x : -1.2 * x; }), spring);
  EXPECT_LT(stronger->unexplained_minimum, -5);
  EXPECT_GT(stronger->unexplained_return / stronger->store, 1.2);

  SessionRecording late = swinging(4, [](double x, double) { return -x; });
  for (std::size_t i = late.force_sent.size() - 1; i > 2; --i)
    late.force_sent[i] = late.force_sent[i - 2];
  const double step = 2 * kAmplitude * std::sin(units::kPi / kCycle);
  EXPECT_NEAR(device_port_figures(late, spring)->unexplained_minimum,
              -2 * 4 * kCycle / 2.0 * step * step, 0.1);
}

// A glitch of a reading moves nothing: the session makes no step in it.
TEST(DevicePort, ARejectedReadingCountsForNothing) {
  const PortSpring spring{1, 0, 0};
  SessionRecording r = swinging(2, [](double x, double) { return -x; });
  const auto before = device_port_figures(r, spring);
  r.device_position[300].x() += 20;
  r.flags[300] |= kReadingRejected;
  const auto after = device_port_figures(r, spring);
  EXPECT_NEAR(after->sampling, before->sampling, 0.01 * before->sampling);
  EXPECT_GT(after->unexplained_minimum, -0.05);
}

TEST(DevicePort, WithoutForceThereIsNothingToObserve) {
  EXPECT_EQ(device_port_figures(made_recording(10)).why_not, "the device never sent a force");
}

TEST(BurPort, TorqueWorkAndRemovedEnergyOfTheRows) {
  SessionRecording r = made_recording(1001);
  const Parameters p = preset_parameters("paper");
  r.complete = false;
  const double u = p.tissue[0].specific_energy;
  for (std::size_t i = 0; i <= 1000; ++i) {
    StepRecord& row = r.header.trace.rows[i];
    row.power = i == 0 ? 0 : 3;                                     // N·mm/s, for 1 s
    row.removed_volume[0] = static_cast<double>(i) * 1e-3 * 2 / u;  // 2 mJ in all
    row.grinding_force = Vec3(0, 2, 0);
    row.bur_velocity = Vec3(0, -0.5, 0);
  }
  const auto f = bur_port_figures(r, p);
  ASSERT_TRUE(f);
  EXPECT_NEAR(f->torque_work, 3, 1e-12);
  EXPECT_NEAR(f->removed_energy, 2, 1e-12);
  EXPECT_NEAR(f->ratio, 1.5, 1e-12);
  EXPECT_NEAR(f->feed_work, 1, 1e-12);  // 2 N against 0.5 mm/s for 1 s
  EXPECT_EQ(f->feed_minimum, 0);
  EXPECT_FALSE(f->audited);

  r.complete = true;
  r.header.trace.audit = {4, 5, 0.8};
  const auto audited = bur_port_figures(r, p);
  EXPECT_TRUE(audited->audited);
  EXPECT_DOUBLE_EQ(audited->ratio, 0.8);
  EXPECT_FALSE(bur_port_figures(made_recording(10), p));
}

TEST(BurPort, AContactThatPushesTheBurShowsBelowZero) {
  SessionRecording r = made_recording(101);
  for (std::size_t i = 1; i <= 100; ++i) {
    r.header.trace.rows[i].power = 1;
    r.header.trace.rows[i].grinding_force = Vec3(1, 0, 0);
    r.header.trace.rows[i].bur_velocity = Vec3(i <= 50 ? 1 : -1, 0, 0);
  }
  EXPECT_NEAR(bur_port_figures(r, preset_parameters("paper"))->feed_minimum, -0.05, 1e-12);
}

TEST(Lag, IsForceOverStiffnessByTheCouplingsLaw) {
  SessionRecording r = made_recording(1000);
  Parameters p = preset_parameters("paper");
  p.coupling.stiffness = 0.8;
  p.coupling.damping = 1e-3;
  for (std::size_t i = 0; i < 1000; ++i) {
    StepRecord& row = r.header.trace.rows[i];
    const double s = static_cast<double>(i) * 1e-3;
    row.handle.pose.position = Vec3(3 * s, 0, 0);
    row.bur.position = Vec3(3 * s, 2 * s, 0);  // 2 mm behind at the end of a second
    row.bur_velocity = Vec3(3, 2, 0);
    if (i > 0) row.device_force = -(0.8 * Vec3(0, -2 * s, 0) + 1e-3 * Vec3(0, -2, 0));
  }
  const auto f = lag_figures(r, p);
  ASSERT_TRUE(f);
  EXPECT_NEAR(f->mean, 0.999, 1e-12);
  EXPECT_NEAR(f->largest, 1.998, 1e-12);
  EXPECT_NEAR(f->largest_at, 0.999, 1e-12);
  EXPECT_NEAR(f->law_residual, 0, 1e-12);
  EXPECT_NEAR(f->largest_force_over_k, 1.998 + 2e-3 / 0.8, 1e-12);

  r.header.trace.rows[500].device_force[2] += 0.04;  // 0.05 mm of spring
  EXPECT_NEAR(lag_figures(r, p)->law_residual, 0.05, 1e-12);
  r.header.trace.drive = "direct";
  EXPECT_FALSE(lag_figures(r, p));
}

// From cold, a constant force F heats to F² (1 - exp(-t/tau)). A force of F for a fifth of the
// time has the rms F sqrt(1/5).
TEST(Thermal, FollowsTheFirstOrderModelAndTheWindow) {
  SessionRecording r = made_recording(20001);
  for (std::size_t i = 1; i <= 4000; ++i) r.force_sent[i] = Vec3(0, 0, 3);
  const auto f = thermal_figures(r, kMethod);
  ASSERT_TRUE(f);
  EXPECT_NEAR(f->rms, 3 * std::sqrt(0.2), 1e-9);
  EXPECT_NEAR(f->worst_window_rms, 3 * std::sqrt(0.4), 1e-3);
  EXPECT_NEAR(f->model_force, 3 * std::sqrt(1 - std::exp(-0.4)), 1e-9);
  EXPECT_NEAR(f->load, f->model_force / 1.75, 1e-12);
  EXPECT_EQ(f->peak_force, 3);
  r.header.max_continuous_force_n = 0;
  EXPECT_TRUE(std::isnan(thermal_figures(r, kMethod)->load));
}

}  // namespace
}  // namespace toothprep
