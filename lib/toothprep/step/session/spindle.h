// What the handpiece's spindle can do in a step: the torque that it has left at a rotation rate.
//
// A drive gives tau_s (1 - (N/N0)^k) (droop), or up to tau_s at whatever rate a governor holds it to
// (fixed). A rotor of inertia J adds what it gives up by slowing down, by backward Euler
//   T(N) = T_drive(N) - 2 pi J (N - N_before) / h,
// which with the motor off is that of the bearings, by which a free rotor stops from N0 within the
// run-down time. It stalls when no N will do: the rotor's energy is used up as well.
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

// Where `falls`, which is true at `low` and false at `high`, changes: as close as doubles are.
template <typename Falls>
double last_true(double low, double high, const Falls& falls) noexcept {
  for (;;) {
    const double middle = low + (high - low) / 2;
    if (!(middle > low && middle < high)) return low;
    (falls(middle) ? low : high) = middle;
  }
}

// What the handpiece can do in a step.
class Spindle {
 public:
  Spindle() = default;  // stands, and gives nothing

  // `before`: the rotation rate that the last step ended with, rev/s; of no account without inertia.
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
  // rev/s: without a load, which is the largest.
  double free_rate() const noexcept { return free_rate_; }
  // Whether the rate depends on the torque.
  bool slows() const noexcept { return slows_; }

  // N·mm, at a rate in rev/s.
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
