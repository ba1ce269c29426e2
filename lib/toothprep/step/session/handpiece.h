// The handpiece: what rotation rate it turns at under load, and when it stalls (Eqs 10, 11).
//
//   fixed   N = N0 whatever the torque; stalls when the judged torque is above tau_s
//   droop   T = tau_s (1 - (N/N0)^k); stalls when no N in (0, N0] gives the torque that it needs
//
// With an imposed feed the power u Q = 2 pi T N is given, whatever N is, so that for k = 1
//   T = (tau_s/2) (1 - sqrt(1 - u Q / P_max)),  P_max = pi N0 tau_s / 2,  no solution above P_max.
// Otherwise x = N/N0 solves x (1 - x^k) = u Q / (2 pi N0 tau_s) by bisection above the greatest
// power's x, which is (k + 1)^(-1/k).
// With an imposed force the torque hardly depends on N (B ~ 1/N, v ~ N): inserting settles in a few
// turns, and bisection of (0, N0] is there for when it doesn't.
#pragma once

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/parameters.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/session/step_state.h"

namespace toothprep {

inline bool droops(const Handpiece& handpiece) noexcept {
  return handpiece.model == HandpieceModel::kDroop && std::isfinite(handpiece.stall_torque);
}

// x^k for x in [0, 1] and k a whole number of halves: products and a square root, which round alike
// on every machine.
inline double droop_power(double x, double k) noexcept {
  double power = 1;
  for (int i = 1; i <= static_cast<int>(k); ++i) power *= x;
  return k == std::floor(k) ? power : power * std::sqrt(x);
}

// Where `falls`, which is true at `low` and false at `high`, changes: as close as doubles are.
template <typename Falls>
double last_true(double low, double high, const Falls& falls) noexcept {
  for (;;) {
    const double middle = low + (high - low) / 2;
    if (!(middle > low && middle < high)) return low;
    (falls(middle) ? low : high) = middle;
  }
}

// N/N0 at the share T/tau_s of the stall torque.
inline double droop_rate(double share, double k) noexcept {
  if (k == 1) return 1 - share;
  return share > 0 ? last_true(0, 1, [&](double x) { return droop_power(x, k) <= 1 - share; }) : 1;
}

// The trial's rotation rate, torque and operating point for an imposed feed that takes the torque
// `unit_torque` (N·mm) at 1 rev/s.
inline void turn_at_imposed_feed(const Handpiece& handpiece, double unit_torque,
                                 Trial& trial) noexcept {
  trial.rotation_rate = handpiece.rotation_rate;
  const double k = handpiece.droop_exponent;
  if (droops(handpiece) && unit_torque > 0 && k != 1) {
    const double needed = unit_torque / (handpiece.rotation_rate * handpiece.stall_torque);
    const auto gives = [&](double x) { return x * (1 - droop_power(x, k)) >= needed; };
    const double best = droop_rate(k / (k + 1), k);
    trial.operating_point = gives(best);
    trial.rotation_rate *= trial.operating_point ? last_true(best, 1, gives) : best;
  } else if (droops(handpiece) && unit_torque > 0) {
    const double p_max = units::kPi * handpiece.rotation_rate * handpiece.stall_torque / 2;
    const double rest = 1 - 2 * units::kPi * unit_torque / p_max;
    trial.operating_point = rest >= 0;
    trial.rotation_rate *= (1 + std::sqrt(std::max(rest, 0.0))) / 2;
  }
  trial.torque = unit_torque / trial.rotation_rate;
}

// The trial at the rate at which the handpiece gives the torque that the trial takes. `trial_at(N,
// guess)` solves the step at a rotation rate, starting from a velocity.
template <typename TrialAt>
Trial turn_at_imposed_force(const Handpiece& handpiece, const Trial& at_full_rate,
                            const TrialAt& trial_at) noexcept {
  constexpr int kMaxDirectIterations = 12;  // before bisection
  constexpr double kRateTolerance = 1e-9;   // of N0
  constexpr double kTinyRate = 1e-6;        // of N0: stands for N -> 0
  if (!droops(handpiece) || at_full_rate.torque <= 0) return at_full_rate;

  const double n0 = handpiece.rotation_rate;
  Trial trial = trial_at(kTinyRate * n0, at_full_rate.velocity);
  if (trial.torque > handpiece.stall_torque) {
    trial.operating_point = false;
    return trial;
  }
  const auto rate_for = [&](double torque) {
    return std::max(kTinyRate * n0,
                    n0 * droop_rate(torque / handpiece.stall_torque, handpiece.droop_exponent));
  };
  trial = at_full_rate;
  double rate = rate_for(trial.torque);
  for (int i = 0; i < kMaxDirectIterations; ++i) {
    trial = trial_at(rate, trial.velocity);
    const double next = rate_for(trial.torque);
    if (std::abs(next - rate) <= kRateTolerance * n0) return trial;
    rate = next;
  }
  double low = kTinyRate * n0, high = n0;
  while (high - low > kRateTolerance * n0) {
    const double middle = (low + high) / 2;
    trial = trial_at(middle, trial.velocity);
    (rate_for(trial.torque) > middle ? low : high) = middle;
  }
  return trial;
}

// Whether the handpiece stalls. `judged_torque` is that of the trial or, by the literal rule, of
// the step before.
inline bool stalls(const Handpiece& handpiece, const Trial& trial, double judged_torque) noexcept {
  if (droops(handpiece)) return !trial.operating_point;
  return judged_torque > handpiece.stall_torque;
}

}  // namespace toothprep
