// The handpiece: what rotation rate it turns at under load, and when it stalls (Eqs 10, 11).
//
//   fixed   N = N0 whatever the torque; stalls when the judged torque is above tau_s
//   droop   T = tau_s (1 - (N/N0)^k); stalls when no N in (0, N0] gives the torque that it needs
//
// With an imposed feed the power u Q = 2 pi T N is given, whatever N is, so that for k = 1
//   T = (tau_s/2) (1 - sqrt(1 - u Q / P_max)),  P_max = pi N0 tau_s / 2,  no solution above P_max.
// Otherwise N T(N) = u Q / (2 pi) is solved by bisection above the rate of the greatest power
// (spindle.h, which also has the rotor's inertia).
// With an imposed force the torque hardly depends on N (B ~ 1/N, v ~ N): inserting settles in a few
// turns, and bisection is there for when it doesn't.
#pragma once

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/parameters.h"
#include "toothprep/step/session/spindle.h"
#include "toothprep/step/session/step_state.h"

namespace toothprep {

// A root of `f`, which is not negative at `low` and negative at `high`, to `tolerance`: by false
// position that halves the end that stays (Illinois). f is not negative at what is returned.
template <typename F>
double root_between(double low, double high, double tolerance, const F& f) noexcept {
  constexpr int kMost = 100;  // a bisection every third time would need 90
  double at_low = f(low), at_high = f(high);
  for (int i = 0; i < kMost && high - low > tolerance && at_low > 0; ++i) {
    const double share = i % 3 == 2 ? 0.5 : at_low / (at_low - at_high);
    // Half a tolerance from either end, so that a root next to it is enclosed.
    const double x =
        std::clamp(low + share * (high - low), low + tolerance / 2, high - tolerance / 2);
    const double at_x = f(x);
    if (at_x >= 0) {
      low = x, at_low = at_x, at_high /= 2;
    } else {
      high = x, at_high = at_x, at_low /= 2;
    }
  }
  return low;
}

// The trial's rotation rate, torque and operating point for an imposed feed that takes the torque
// `unit_torque` (N·mm) at 1 rev/s.
inline void turn_at_imposed_feed(const Spindle& spindle, double unit_torque,
                                 Trial& trial) noexcept {
  trial.rotation_rate = spindle.free_rate();
  if (spindle.slows() && unit_torque > 0) {
    const double rate = spindle.rate_with(unit_torque);
    trial.operating_point = rate > 0;
    trial.rotation_rate = trial.operating_point ? rate : spindle.rate_of_greatest_power();
  }
  trial.torque = unit_torque / trial.rotation_rate;
}

// The same where the torque at 1 rev/s, `unit_torque(N)`, depends on the rotation rate, which a law
// that isn't linear in the chip thickness makes it do. N is the largest rate at which the handpiece
// gives the power: looked for from the free rate downwards, then by bisection.
template <typename UnitTorque>
void turn_at_imposed_feed_of(const Spindle& spindle, const UnitTorque& unit_torque,
                             Trial& trial) noexcept {
  constexpr int kPlaces = 32;              // of (0, n], and of a place where none gives it
  constexpr double kRateTolerance = 1e-9;  // of n
  const double n = spindle.free_rate();
  const auto spare = [&](double x) { return x * n * spindle.torque(x * n) - unit_torque(x * n); };
  trial.rotation_rate = n;
  if (spindle.slows() && unit_torque(n) > 0) {
    double best = 1, most = spare(1);
    for (int i = kPlaces - 1; i > 0 && most < 0; --i) {
      const double x = static_cast<double>(i) / kPlaces, s = spare(x);
      if (s > most) best = x, most = s;
    }
    // None of the places: perhaps between them.
    double low = std::max(best - 1.0 / kPlaces, 0.0), high = std::min(best + 1.0 / kPlaces, 1.0);
    for (int i = 0; i < kPlaces && most < 0; ++i) {
      const double a = low + (high - low) / 3, b = high - (high - low) / 3;
      const bool left = spare(a) > spare(b);
      (left ? high : low) = left ? b : a;
      best = left ? a : b;
      most = spare(best);
    }
    trial.operating_point = most >= 0;
    if (trial.operating_point && best < 1)
      best = root_between(best, std::min(best + 1.0 / kPlaces, 1.0), kRateTolerance, spare);
    trial.rotation_rate = best * n;
  }
  trial.torque = unit_torque(trial.rotation_rate) / trial.rotation_rate;
}

// The trial at the rate at which the handpiece gives the torque that the trial takes. `trial_at(N,
// guess)` solves the step at a rotation rate, starting from a velocity. The rate is settled to
// `tolerance` of the free rate.
template <typename TrialAt>
Trial turn_at_imposed_force(const Spindle& spindle, const Trial& at_free_rate,
                            const TrialAt& trial_at, double tolerance) noexcept {
  constexpr int kMaxDirectIterations = 12;  // before bisection
  constexpr double kTinyRate = 1e-6;        // of the free rate: stands for N -> 0
  const double n = spindle.free_rate();
  if (!spindle.slows() || at_free_rate.torque <= std::max(spindle.torque(n), 0.0))
    return at_free_rate;

  Trial trial = trial_at(kTinyRate * n, at_free_rate.velocity);
  if (trial.torque > spindle.torque(0)) {
    trial.operating_point = false;
    return trial;
  }
  const auto rate_for = [&](double torque) {
    return std::clamp(spindle.rate_at(torque), kTinyRate * n, n);
  };
  trial = at_free_rate;
  double rate = rate_for(trial.torque);
  for (int i = 0; i < kMaxDirectIterations; ++i) {
    trial = trial_at(rate, trial.velocity);
    const double next = rate_for(trial.torque);
    if (std::abs(next - rate) <= tolerance * n) return trial;
    rate = next;
  }
  double low = kTinyRate * n, high = n;
  while (high - low > tolerance * n) {
    const double middle = (low + high) / 2;
    trial = trial_at(middle, trial.velocity);
    (rate_for(trial.torque) > middle ? low : high) = middle;
  }
  return trial;
}

// Whether the handpiece stalls. `judged_torque` is that of the trial or, by the literal rule, of
// the step before.
inline bool stalls(const Handpiece& handpiece, const Spindle& spindle, const Trial& trial,
                   double judged_torque) noexcept {
  if (spindle.slows()) return !trial.operating_point;
  return judged_torque > handpiece.stall_torque;
}

}  // namespace toothprep
