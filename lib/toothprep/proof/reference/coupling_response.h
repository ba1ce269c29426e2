// How a bur on its coupling answers: ringing in free air, and what of the tissue's resistance
// reaches the hand. Exact solutions of the linear equation and of its backward Euler steps.
//
//   m bur's mass, N·s²/mm   k coupling, N/mm   b its damper, N·s/mm   h time step, s; 0: no steps
//   B resistance of the tissue, N·s/mm         x = P - P_H, the handle at rest
//
// Free air, m x'' + b x' + k x = 0, released from rest at x_0:
//   without steps   s² + (b/m) s + k/m = 0                         f = sqrt(k/m)/2 pi
//   backward Euler  z² - (1 + (m - h² k)/M) z + m/M = 0,  M = m + h b + h² k
//       x_0 = 1, x_1 = 1 - h² k/M; while z is complex |z| = sqrt(m/M), so that without a damper
//       n steps leave (1 + h² k/m)^(-n/2): the damping is the integrator's, and goes with h
//
// In tissue, F = -B v, with the handle moved as exp(s t), s = 2 pi i f, or for backward Euler
// (1 - exp(-2 pi i f h))/h: the force on the hand over that of direct drive, B s x_H,
//   T = (k + b s)(m s + B) / (B (m s² + (b + B) s + k))
//   1 for slow motion, 1/2 in power at 2 pi f = k/B where m and b are small, b/(b + B) far above
#pragma once

#include <complex>
#include <vector>

namespace toothprep::reference {

struct BurOnCoupling {
  double mass = 8e-6;    // m, > 0
  double stiffness = 1;  // k, > 0
  double damping = 0;    // b, >= 0
  double time_step = 0;  // h, >= 0; 0: the equation itself
};

// sqrt(k/m)/2 pi, Hz.
[[nodiscard]] double free_air_frequency(const BurOnCoupling& bur);

// x/x_0 in free air after `time` (s, >= 0; of steps the nearest) of a release from rest.
[[nodiscard]] double released(const BurOnCoupling& bur, double time);

// The largest |x/x_0| from `time` (s) on: 1 for a bur that rings for ever.
[[nodiscard]] double remaining(const BurOnCoupling& bur, double time);

// The least b (to 1e-6 N·s/mm) with which remaining() is at most `share` (of 1) after `time` at each
// of `time_steps`; NaN if none up to three times the critical 2 sqrt(k m) is enough.
[[nodiscard]] double least_damping(double mass, double stiffness,
                                   const std::vector<double>& time_steps, double time,
                                   double share);

// T at `frequency` (Hz, > 0) with the resistance B > 0.
[[nodiscard]] std::complex<double> rendered_share(const BurOnCoupling& bur, double resistance,
                                                  double frequency);

}  // namespace toothprep::reference
