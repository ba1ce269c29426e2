// The torque that the spindle delivers during a step, as a function of the rotation rate at its end.
//
// The drive delivers tau_s (1 - (N/N0)^k) (droop), or up to tau_s below the governed rate (fixed).
// With the motor off the bearing friction, a constant torque, stops a free rotor from N0 within the
// run-down time. The inertia J of the rotor adds, by backward Euler,
//   T(N) = T_drive(N) - 2 pi J (N - N_before) / h.
// The spindle stalls when no N > 0 delivers the torque that is needed.
#pragma once

#include <algorithm>
#include <cmath>

#include "toothprep/step/core/parameters.h"
#include "toothprep/step/core/units.h"

namespace toothprep {

// x^k for x in [0, 1] and k a whole number of halves: products and a square root, which round alike
// on every machine.
inline double droop_power(double x, double k) noexcept {
  double power = 1;
  for (int i = 1; i <= static_cast<int>(k); ++i) power *= x;
  return k == std::floor(k) ? power : power * std::sqrt(x);
}

// The largest double in [low, high) for which `falls`, true at `low` and false at `high`, is true.
template <typename Falls>
double last_true(double low, double high, const Falls& falls) noexcept {
  for (;;) {
    const double middle = low + (high - low) / 2;
    if (!(middle > low && middle < high)) return low;
    (falls(middle) ? low : high) = middle;
  }
}

class Spindle {
 public:
  Spindle() = default;  // at rest, without torque

  // `before`: rotation rate at the end of the previous step, rev/s; unused without inertia.
  Spindle(const Handpiece& handpiece, bool motor_on, double before, double h) noexcept
      : motor_on_(motor_on), n0_(handpiece.rotation_rate), k_(handpiece.droop_exponent) {
    const double stall_torque = handpiece.stall_torque;
    const double inertia = 2 * units::kPi * handpiece.rotor_inertia / h;
    const bool droops =
        motor_on && handpiece.model == HandpieceModel::kDroop && std::isfinite(stall_torque);
    const double stops = handpiece.run_down > 0 ? n0_ * h / handpiece.run_down : before;
    slows_ = droops || inertia > 0;
    at_rest_ = motor_on ? stall_torque : -inertia * stops;
    if (inertia > 0) at_rest_ += inertia * before;
    slope_ = inertia + (droops && k_ == 1 ? stall_torque / n0_ : 0);
    curved_ = droops && k_ != 1 ? stall_torque : 0;
    if (motor_on) free_rate_ = slows_ ? rate_at(0) : n0_;
    if (!motor_on && inertia > 0) free_rate_ = std::max(before - stops, 0.0);
  }

  bool motor_on() const noexcept { return motor_on_; }
  bool turns() const noexcept { return free_rate_ > 0; }
  // Without load, rev/s: the largest rate.
  double free_rate() const noexcept { return free_rate_; }
  // Whether the rate depends on the torque.
  bool slows() const noexcept { return slows_; }

  // Available torque at a rate in rev/s, N·mm.
  double torque(double rate) const noexcept {
    return at_rest_ - slope_ * rate - (curved_ > 0 ? curved_ * droop_power(rate / n0_, k_) : 0);
  }

  // The largest rate with at least this torque, rev/s; 0 if there is none.
  double rate_at(double wanted) const noexcept {
    if (torque(0) < wanted) return 0;
    if (torque(n0_) >= wanted) return n0_;
    if (curved_ == 0) return std::min((at_rest_ - wanted) / slope_, n0_);
    return last_true(0, n0_, [&](double rate) { return torque(rate) >= wanted; });
  }

  // The rate at which N T(N), which has one maximum, is greatest, rev/s.
  double rate_of_greatest_power() const noexcept {
    if (curved_ == 0) return std::min(at_rest_ / (2 * slope_), free_rate_);
    const auto rises = [&](double rate) {
      return at_rest_ - 2 * slope_ * rate >= (k_ + 1) * curved_ * droop_power(rate / n0_, k_);
    };
    return rises(free_rate_) ? free_rate_ : last_true(0, free_rate_, rises);
  }

  // The largest rate with N T(N) of at least `wanted`, N·mm·rev/s; 0 if there is none.
  double rate_with(double wanted) const noexcept {
    const auto gives = [&](double rate) { return rate * torque(rate) >= wanted; };
    const double best = rate_of_greatest_power();
    if (!gives(best)) return 0;
    if (gives(free_rate_)) return free_rate_;
    if (curved_ > 0) return last_true(best, free_rate_, gives);
    const double rest = at_rest_ * at_rest_ - 4 * slope_ * wanted;
    return std::min((at_rest_ + std::sqrt(std::max(rest, 0.0))) / (2 * slope_), free_rate_);
  }

 private:
  bool motor_on_ = false, slows_ = false;
  double n0_ = 1, k_ = 1, free_rate_ = 0;
  // T(N) = at_rest - slope N - curved (N/N0)^k, N·mm; 2 pi J / h is in the first two.
  double at_rest_ = 0, slope_ = 0, curved_ = 0;
};

}  // namespace toothprep
