// A rotor with inertia: spin-up, run-down and what a load does to the rotation rate, against the
// solutions of 2 pi J dN/dt = T_drive(N) - T.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "experiment.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/session/handpiece.h"

namespace toothprep::testing::rotor {
namespace {

constexpr double kN0 = 100, kStall = 2.0, kAlpha = 0.25, kR = 0.6, kL = 1.5;
constexpr double kTau = 0.2;                                     // s: 2 pi J N0 / tau_s
constexpr double kJ = kTau * kStall / (2 * units::kPi * kN0);    // t·mm²
constexpr double kTorquePerLoad = 4 * kAlpha * kR / units::kPi;  // mm: of a full slot on a rail
const Vec3 kInAir(0, 5, 0), kInside(0, -1, 0), kAlongFeed(0, -1, 0);

Parameters with_rotor(HandpieceModel model, double exponent = 1, double inertia = kJ) {
  Parameters p = preset_parameters("paper");
  p.handpiece.model = model;
  p.handpiece.rotation_rate = kN0;
  p.handpiece.stall_torque = kStall;
  p.handpiece.droop_exponent = exponent;
  p.handpiece.rotor_inertia = inertia;
  p.load.rail = {0, -1, 0};
  validate(p);
  return p;
}

LayeredTooth slot_block() { return block(0.1, 8, Vec3(4, 8, 3)); }

struct Pushed {
  double load = 0;  // N, along the feed
  bool pedal = true;
};

// Held at `start` for so long; `at(t)` says under what load, and whether the pedal is pressed.
template <typename At>
std::vector<HandleSample> held(const Vec3& start, double seconds, double h, const At& at) {
  std::vector<HandleSample> path;
  for (int i = 0; i <= std::lround(seconds / h); ++i) {
    const Pushed pushed = at(i * h);
    HandleSample s;
    s.time = i * h;
    s.pose.position = start;
    s.load = pushed.load * kAlongFeed;
    s.buttons = pushed.pedal ? kPedalButton : 0;
    path.push_back(s);
  }
  return path;
}

Outcome loaded(const Parameters& p, const std::vector<HandleSample>& path) {
  return run(slot_block(), paper_cylinder(), p, Drive::kLoad, path);
}

// From rest in the air, the pedal pressed after the first sample.
Outcome spun_up(Parameters p, double seconds, double h = 1e-3) {
  p.time_step = h;
  return run(slot_block(), paper_cylinder(), p, Drive::kDirect,
             held(kInAir, seconds, h, [](double t) {
               return Pushed{0, t > 0};
             }));
}

TEST(Rotor, SpinsUpFromRestByTheSolutionOfItsDrive) {
  const auto droop = spun_up(with_rotor(HandpieceModel::kDroop), 1);
  const auto square = spun_up(with_rotor(HandpieceModel::kDroop, 2), 1);
  const auto governed = spun_up(with_rotor(HandpieceModel::kFixed), 1);
  EXPECT_EQ(droop.rows[0].rotation_rate, 0);
  for (std::size_t i = 1; i < droop.rows.size(); ++i) {
    const double t = static_cast<double>(i) * 1e-3, steps = static_cast<double>(i);
    EXPECT_NEAR(droop.rows[i].rotation_rate, kN0 * (1 - std::pow(1 + 1e-3 / kTau, -steps)), 1e-9);
    EXPECT_NEAR(droop.rows[i].rotation_rate, kN0 * (1 - std::exp(-t / kTau)), 2e-3 * kN0);
    EXPECT_NEAR(square.rows[i].rotation_rate, kN0 * std::tanh(t / kTau), 2e-3 * kN0);
    EXPECT_NEAR(governed.rows[i].rotation_rate, kN0 * std::min(t / kTau, 1.0), 1e-9);
  }
}

TEST(Rotor, ErrorOfTheSpinUpIsHalvedWithTheTimeStep) {
  std::vector<double> error;
  for (const double h : {4e-3, 2e-3, 1e-3}) {
    const Outcome r = spun_up(with_rotor(HandpieceModel::kDroop, 2), 0.2, h);
    error.push_back(std::abs(r.rows.back().rotation_rate - kN0 * std::tanh(0.2 / kTau)));
    std::printf("h = %g ms: %.4f rev/s off\n", 1e3 * h, error.back());
  }
  EXPECT_NEAR(error[0] / error[1], 2, 0.1);
  EXPECT_NEAR(error[1] / error[2], 2, 0.1);
}

TEST(Rotor, APedalThatIsPressedInTheFirstSampleFindsItAtItsFreeSpeed) {
  const auto r = run(slot_block(), paper_cylinder(), with_rotor(HandpieceModel::kDroop),
                     Drive::kDirect, held(kInAir, 0.1, 1e-3, [](double) { return Pushed{}; }));
  for (std::size_t i = 1; i < r.rows.size(); ++i) EXPECT_NEAR(r.rows[i].rotation_rate, kN0, 1e-9);
}

TEST(Rotor, RunsDownEvenlyWithinItsTimeOrIsBrakedAtOnce) {
  Parameters p = with_rotor(HandpieceModel::kDroop);
  const auto path = held(kInAir, 1, 1e-3, [](double t) { return Pushed{0, t < 0.0995}; });
  const auto braked = run(slot_block(), paper_cylinder(), p, Drive::kDirect, path);
  p.handpiece.run_down = 0.5;
  const auto free = run(slot_block(), paper_cylinder(), p, Drive::kDirect, path);
  for (std::size_t i = 100; i < path.size(); ++i) {
    const double since = path[i].time - 0.099;
    EXPECT_NEAR(free.rows[i].rotation_rate, kN0 * std::max(1 - since / 0.5, 0.0), 1e-8) << i;
    EXPECT_EQ(braked.rows[i].rotation_rate, 0);
  }
}

// On a rail the torque of a load is F 4 alpha R/pi whatever N is, so that N approaches
// N0 (1 - T/tau_s) with the time constant of the free rotor.
TEST(Rotor, UnderALoadTheRateApproachesItsPlaceByTheExponential) {
  const double load = 0.5 * kStall / kTorquePerLoad;
  const Outcome r = loaded(with_rotor(HandpieceModel::kDroop),
                           held(kInside, 1, 1e-3, [&](double) { return Pushed{load}; }));
  EXPECT_EQ(r.totals.stalled_steps, 0);
  for (const std::size_t i : {50u, 200u, 400u, 1000u}) {
    const double t = static_cast<double>(i) * 1e-3, share = r.rows[i].torque / kStall;
    EXPECT_NEAR(share, 0.5, 0.005);
    EXPECT_NEAR(r.rows[i].rotation_rate, kN0 * (1 - 0.5 * (1 - std::exp(-t / kTau))), 0.005 * kN0);
  }
}

// Of more than the stall torque, the rate falls as (1 - T/tau_s)(1 - e^(-t/tau)) + e^(-t/tau): to
// zero at tau ln(s/(s - 1)), s = T/tau_s.
TEST(Rotor, ALoadBeyondTheStallTorqueStopsItWhenItsEnergyIsUsedUpAndLessLetsItGo) {
  const double s = 1.5, load = s * kStall / kTorquePerLoad;
  const Outcome r =
      loaded(with_rotor(HandpieceModel::kDroop),
             held(kInside, 1, 1e-3, [&](double t) { return Pushed{t < 0.6 ? load : load / 3}; }));
  const double stop = kTau * std::log(s / (s - 1));
  std::size_t first = 0, last = 0;
  for (std::size_t i = 0; i < r.rows.size(); ++i)
    if (r.rows[i].stalled) first = first ? first : i, last = i;
  EXPECT_NEAR(static_cast<double>(first) * 1e-3, stop, 0.02 * stop + 2e-3);
  EXPECT_EQ(last, 599u);
  EXPECT_EQ(r.totals.stall_onsets, 1);
  EXPECT_EQ(r.rows[599].rotation_rate, 0);
  EXPECT_NEAR(r.rows.back().rotation_rate, kN0 / 2 * (1 - std::exp(-0.4 / kTau)), 0.01 * kN0);
}

TEST(Rotor, WithTheMotorOffItGoesOnCuttingUntilLoadAndBearingsHaveStoppedIt) {
  Parameters p = with_rotor(HandpieceModel::kFixed);
  p.handpiece.run_down = 4 * kTau;  // its bearings take tau_s / 4
  const double load = 0.5 * kStall / kTorquePerLoad;
  const Outcome r = loaded(p, held(kInside, 1, 1e-3, [&](double t) {
                             return Pushed{load, t < 0.1995};
                           }));
  const double stop = 0.199 + kTau / (0.25 + 0.5);
  for (std::size_t i = 1; i < r.rows.size(); ++i) {
    const double t = r.rows[i].handle.time, since = std::max(t - 0.199, 0.0);
    EXPECT_NEAR(r.rows[i].rotation_rate, kN0 * std::max(1 - since / (stop - 0.199), 0.0),
                0.012 * kN0)
        << t;
    EXPECT_FALSE(r.rows[i].stalled);
  }
  const auto removed = [&](double t) {
    return r.rows[static_cast<std::size_t>(std::lround(t * 1e3))].removed_volume[0];
  };
  EXPECT_GT(removed(stop - 0.02), removed(0.2) * 1.2);
  EXPECT_EQ(removed(stop + 0.01), removed(0.999));
  EXPECT_EQ(r.rows.back().bur_velocity.norm(), 0);
}

// A governed rotor against an imposed feed of more than its power, c = u Q/(2 pi) > N0 tau_s:
// 2 pi J N dN/dt = N tau_s - c stops after 2 pi J/tau_s (c/tau_s ln(c/(c - N0 tau_s)) - N0).
TEST(Rotor, AnImposedFeedBeyondItsPowerStopsItAfterTheIntegralsTime) {
  Parameters p = with_rotor(HandpieceModel::kFixed);
  for (const double excess : {1.2, 2.0}) {
    const double c = excess * kN0 * kStall;
    const double feed = 2 * units::kPi * c / (p.tissue[0].specific_energy * 2 * kR * kL);
    p.time_step = 2e-4;
    const auto path = straight_path({kInside, kInside + 6 * kAlongFeed}, feed, {}, p.time_step);
    const Outcome r = run(slot_block(), paper_cylinder(), p, Drive::kDirect, path);
    const double exact = kTau / kN0 * (c / kStall * std::log(c / (c - kN0 * kStall)) - kN0);
    std::size_t i = 0;
    while (i < r.rows.size() && !r.rows[i].stalled) ++i;
    ASSERT_LT(i, r.rows.size());
    EXPECT_NEAR(r.rows[i].handle.time, exact, 0.02 * exact) << excess;
    std::printf("stops after %.4f s, exact %.4f s\n", r.rows[i].handle.time, exact);
  }
}

TEST(Rotor, AnImposedFeedSettlesWhereTheDroopWithoutInertiaIs) {
  for (const double k : {1.0, 2.0}) {
    const double c = 0.2 * kN0 * kStall;
    Parameters p = with_rotor(HandpieceModel::kDroop, k);
    const double feed = 2 * units::kPi * c / (p.tissue[0].specific_energy * 2 * kR * kL);
    const auto path = straight_path({kInside, kInside + 4.5 * kAlongFeed}, feed);
    ASSERT_GT(path.back().time, 6 * kTau);
    const Outcome slow = run(slot_block(), paper_cylinder(), p, Drive::kDirect, path);
    p.handpiece.rotor_inertia = 0;
    const Outcome at_once = run(slot_block(), paper_cylinder(), p, Drive::kDirect, path);
    EXPECT_NEAR(slow.rows.back().rotation_rate, at_once.rows.back().rotation_rate, 0.005 * kN0);
    EXPECT_GT(slow.rows[20].rotation_rate, at_once.rows[20].rotation_rate + 0.05 * kN0);
  }
}

TEST(Rotor, AVanishingInertiaGivesTheDroopWithoutIt) {
  Parameters p = with_rotor(HandpieceModel::kDroop, 1, 1e-13);
  const auto path = straight_path({Vec3(0, 0.7, 0), Vec3(0, -0.5, 0)}, 0.5);
  for (const Drive drive : {Drive::kDirect, Drive::kCoupled}) {
    p.handpiece.rotor_inertia = 1e-13;
    const Outcome with = run(slot_block(), paper_cylinder(), p, drive, path);
    p.handpiece.rotor_inertia = 0;
    const Outcome without = run(slot_block(), paper_cylinder(), p, drive, path);
    for (std::size_t i = 0; i < path.size(); ++i) {
      EXPECT_NEAR(with.rows[i].rotation_rate, without.rows[i].rotation_rate, 1e-4) << i;
      EXPECT_NEAR((with.rows[i].bur.position - without.rows[i].bur.position).norm(), 0, 1e-6) << i;
    }
  }
}

// Backward Euler's own balance, exact in every step: the drive's work is what is ground, what the
// rotor gained, and half the square of its change.
TEST(Rotor, DrivesWorkIsGroundOrInTheRotor) {
  for (const Drive drive : {Drive::kDirect, Drive::kCoupled}) {
    const Parameters p = with_rotor(HandpieceModel::kDroop, 2);
    const auto path = straight_path({Vec3(0, 0.7, 0), Vec3(0, -1.4, 0), Vec3(0.5, -1.4, 0)}, 0.5);
    const Outcome r = run(block(0.1, 1, Vec3(4, 8, 3)), paper_cylinder(), p, drive, path);
    double driven = 0, gained = 0;
    for (std::size_t i = 1; i < r.rows.size(); ++i) {
      const double before = i == 1 ? kN0 : r.rows[i - 1].rotation_rate;
      const double n = r.rows[i].rotation_rate, x = n / kN0;
      driven += 1e-3 * 2 * units::kPi * n * kStall * (1 - x * x);
      gained += 2 * units::kPi * units::kPi * kJ *
                (n * n - before * before + (n - before) * (n - before));
    }
    ASSERT_EQ(r.totals.split_steps, 0);
    EXPECT_GT(std::abs(gained), 1e-3 * driven);
    EXPECT_NEAR(driven, r.totals.torque_work + gained, 1e-6 * driven);
    EXPECT_NEAR(r.energy_ratio(p), 1, 0.01);
  }
}

TEST(Rotor, StepsOfTensOfMillisecondsStayStable) {
  for (const double h : {1e-3, 0.02, 0.1})
    for (const Drive drive : {Drive::kDirect, Drive::kCoupled}) {
      Parameters p = with_rotor(HandpieceModel::kDroop);
      p.time_step = h;
      const auto path = straight_path({kInside, kInside + 3 * kAlongFeed}, 0.5, {}, h);
      const Outcome r = run(slot_block(), paper_cylinder(), p, drive, path);
      for (std::size_t i = 2; i < r.rows.size(); ++i) {
        EXPECT_GT(r.rows[i].rotation_rate, 0.5 * kN0);
        // It slows down to where the load lets it, and only ripples by voxels there.
        EXPECT_LT(r.rows[i].rotation_rate, r.rows[i - 1].rotation_rate + 0.005 * kN0);
      }
    }
}

// The search for a law that isn't linear, and the closed form of one that is.
TEST(Rotor, BothSearchesFindTheSameRate) {
  Handpiece h = with_rotor(HandpieceModel::kDroop, 1.5).handpiece;
  h.run_down = 1;
  for (const double before : {0.5, 20.0, 80.0, 100.0})
    for (const bool on : {true, false})
      for (const double unit : {0.0, 1.0, 40.0, 90.0, 400.0}) {
        const Spindle spindle(h, on, before, 1e-3);
        Trial closed, searched;
        if (!spindle.turns()) continue;
        turn_at_imposed_feed(spindle, unit, closed);
        turn_at_imposed_feed_of(
            spindle, [&](double) { return unit; }, searched);
        EXPECT_EQ(closed.operating_point, searched.operating_point) << before << " " << unit;
        if (closed.operating_point) {
          EXPECT_NEAR(closed.rotation_rate, searched.rotation_rate, 1e-6) << before << " " << unit;
          EXPECT_NEAR(closed.torque, unit > 0 ? spindle.torque(closed.rotation_rate) : 0, 1e-6)
              << before << " " << unit;
        }
      }
}

}  // namespace
}  // namespace toothprep::testing::rotor
