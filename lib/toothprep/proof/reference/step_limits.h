// Up to which resistance B a scheme of integration or rendering is stable: exact limits of linear
// recurrences, by Jury's conditions on their characteristic polynomials.
//
//   m bur's mass, N·s²/mm   k coupling, N/mm   h = T time step, s   B resistance, N·s/mm
//   M mass of arm and hand, N·s²/mm            a = exp(-2 pi f T), f the filter's cutoff, Hz
//
// The bur on its spring, m v' = -k x - B v, with x = P - P_H:
//   backward Euler   (1 + B h/m + k h²/m) v+ = v - (k h/m) x,  x+ = x + h v+       stable for all B >= 0
//   explicit Euler   v+ = v - (h/m)(k x + B v),  x+ = x + h v
//       z² - (2 - B h/m) z + 1 - B h/m + k h²/m:   k h < B < 2 m/h + k h/2
//   semi-implicit    the same v+,  x+ = x + h v+
//       z² - (2 - B h/m - k h²/m) z + 1 - B h/m:   0 < B < 2 m/h - k h/2
//
// Direct rendering of F = -B w on a mass M, w the difference of two positions over T through a
// first-order low-pass, y+ = a y + (1 - a) w, the force held for a tick:
//       M (v+ - v) = -B T y,  w = (v + v-)/2
//       z² - (1 + a - g (1-a)/2) z + a + g (1-a)/2,  g = B T/M:   B < 2 M/T, whatever a
// The filter shrinks the pulse of one count by 1 - a and delays the force by T/(1 - a); it doesn't
// move the limit.
#pragma once

namespace toothprep::reference {

// m in N·s²/mm, k in N/mm, h in s; limits in N·s/mm, both strict.
struct StableRange {
  double low, high;
};
[[nodiscard]] StableRange explicit_euler_range(double mass, double stiffness, double time_step);
[[nodiscard]] StableRange semi_implicit_euler_range(double mass, double stiffness,
                                                    double time_step);

// 2 M/T, N·s/mm: no function of the filter.
[[nodiscard]] double filtered_rendering_limit(double mass, double time_step);

// T/(1 - a), s: the mean delay of the filtered velocity, less half a tick of the difference.
[[nodiscard]] double filter_delay(double cutoff, double time_step);

}  // namespace toothprep::reference
