// Active checks on the simulated device: a damper rendered directly goes unstable and is switched
// off; the same damper behind the virtual coupling stays quiet.
#include <gtest/gtest.h>

#include <cmath>

#include "live_experiment.h"
#include "toothprep/tools/live/probe_loop.h"

namespace toothprep::testing {
namespace {

constexpr double kPeriod = 1e-3;
constexpr double kStiffness = 1, kMass = 8e-6;  // N/mm, N·s²/mm, of the coupling

// A hand that pulls steadily forward at 0.5 mm/s against `law`, for 4 s.
struct Probe {
  Rows rows;
  LiveStatus status;
};
Probe probe(const ForceLaw& law) {
  SimulatedSettings settings;
  settings.real_time = false;
  settings.hand.mass = 0;  // a light grip; its mass would only raise the limit
  settings.motion = [](double time) {
    DevicePose pose;
    pose.position = Vec3(0.5 * time, 0, 0);
    return pose;
  };
  SimulatedDevice device(settings);
  Probe result;
  ProbeLoop loop(no_watch(), law, &result.rows);
  device.start(loop);
  device.run(4000);
  device.stop();
  result.status = loop.status();
  return result;
}

ForceLaw direct_damper(double damping) {
  return
      [damping](double, const Vec3&, const Vec3& step) { return Vec3(-damping * step / kPeriod); };
}

// The bur of the virtual coupling in a medium of this damping, by backward Euler (Eqs. 16 to 19).
ForceLaw coupled_damper(double damping) {
  struct State {
    Vec3 place = Vec3::Zero(), velocity = Vec3::Zero();
    bool any = false;
  };
  return [damping, state = State()](double, const Vec3& handle, const Vec3&) mutable {
    if (!state.any) state.place = handle, state.any = true;
    state.velocity = (kMass / kPeriod * state.velocity + kStiffness * (handle - state.place)) /
                     (kMass / kPeriod + damping + kStiffness * kPeriod);
    state.place += kPeriod * state.velocity;
    return Vec3(-kStiffness * (handle - state.place));
  };
}

double peak(const Probe& p) {
  double most = 0;
  for (const LiveTick& tick : p.rows.ticks) most = std::max(most, tick.commanded_force.norm());
  return most;
}

TEST(ProbeLoop, ADirectDamperOf100NsPerMGoesUnstableAndIsSwitchedOff) {
  const Probe p = probe(direct_damper(0.1));
  EXPECT_TRUE(p.status.vibrates);
  EXPECT_EQ(p.rows.ticks.back().commanded_force, Vec3::Zero());
  EXPECT_TRUE(p.rows.ticks.back().flags & kForceWithheld);
}

TEST(ProbeLoop, ADirectDamperOf2NsPerMIsStable) {
  const Probe p = probe(direct_damper(0.002));
  EXPECT_FALSE(p.status.vibrates);
  EXPECT_LT(peak(p), 0.1);
}

TEST(ProbeLoop, TheCouplingStaysQuietAtThatDampingAndAt9000) {
  for (const double damping : {0.1, 9.0}) {
    const Probe p = probe(coupled_damper(damping));
    EXPECT_FALSE(p.status.vibrates);
    // A slow rise towards B v, in steps of no more than a count's k D = 0.023 N.
    double jump = 0;
    for (std::size_t n = 1000; n < p.rows.ticks.size(); ++n)
      jump = std::max(
          jump, (p.rows.ticks[n].commanded_force - p.rows.ticks[n - 1].commanded_force).norm());
    EXPECT_LT(jump, 0.05) << damping;
    EXPECT_GT(peak(p), 0.03);
  }
}

DeviceReading reading_at(std::int64_t tick, const Vec3& place) {
  DeviceReading r;
  r.tick = tick;
  r.time = kPeriod * static_cast<double>(tick);
  r.hand.position = place;
  return r;
}

TEST(ProbeLoop, AReadingFarAwayGetsNoForceAndTheLawDoesNotSeeIt) {
  Rows rows;
  double farthest = 0;
  ProbeLoop loop(
      no_watch(),
      [&](double, const Vec3& place, const Vec3&) {
        farthest = std::max(farthest, place.norm());
        return Vec3(-2 * place);
      },
      &rows);
  const Vec3 place(0.5, 0, 0);
  for (int n = 0; n < 500; ++n) loop.tick(reading_at(n, place));
  EXPECT_EQ(loop.tick(reading_at(500, Vec3(20, 0, 0))), Vec3(Vec3::Zero()));
  EXPECT_EQ(farthest, 0.5);
  EXPECT_LT(loop.tick(reading_at(501, place)).norm(), 0.01) << "it is ramped in";
  EXPECT_TRUE(rows.ticks[500].row.handle.rejected);
  EXPECT_TRUE(rows.ticks[500].flags & kReadingRejected);
}

TEST(ProbeLoop, AStylusThatNobodyHoldsGetsNoForce) {
  ProbeLoop loop(
      no_watch(), [](double, const Vec3&, const Vec3&) { return Vec3(0, 1, 0); }, nullptr);
  for (int n = 0; n < 500; ++n) {
    DeviceReading r = reading_at(n, Vec3::Zero());
    r.hand.safety_switch = n < 400;
    const Vec3 force = loop.tick(r);
    if (n == 399) {
      EXPECT_EQ(force, Vec3(0, 1, 0));
    } else if (n >= 400) {
      EXPECT_EQ(force, Vec3(Vec3::Zero()));
    }
  }
}

TEST(ProbeLoop, ItsForceIsRampedOutOnRequest) {
  ProbeLoop loop(
      no_watch(), [](double, const Vec3&, const Vec3&) { return Vec3(0, 1, 0); }, nullptr);
  int n = 0;
  for (; n < 400; ++n) loop.tick(reading_at(n, Vec3::Zero()));
  loop.fade_out(true);
  double last = 1;
  for (; !loop.status().faded && n < 500; ++n) {
    const double force = loop.tick(reading_at(n, Vec3::Zero())).norm();
    EXPECT_LT(last - force, 0.03);
    last = force;
  }
  EXPECT_EQ(last, 0);
  EXPECT_NEAR(n, 450, 3);
}

TEST(ProbeLoop, RecordsThePlaceAndTheForceOfItsLaw) {
  const Probe p = probe([](double time, const Vec3&, const Vec3&) { return Vec3(0, time, 0); });
  ASSERT_EQ(p.rows.ticks.size(), 4000u);
  for (std::size_t n = 1; n < 4000; n += 500) {
    EXPECT_EQ(p.rows.ticks[n].row.handle.time, static_cast<double>(n) * kPeriod);
    EXPECT_EQ(p.rows.ticks[n].row.device_force.y(), static_cast<double>(n) * kPeriod);
    EXPECT_EQ(p.rows.ticks[n].row.handle.pose.position, p.rows.ticks[n].device_position);
  }
}

}  // namespace
}  // namespace toothprep::testing
