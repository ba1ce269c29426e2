// Loads that have a closed form: the bur's head wholly in one tissue, feed v straight, constant
// rotation rate N (Wu, Wang, Wang and Zhang, Eqs 6-9, with the weight ds/r = dphi dl integrated
// over the advancing half, v·n > 0).
//
//   u      specific grinding energy, N/mm²      alpha  F_t / F_n
//   N      rotation rate, rev/s                 R      radius, mm
//   L      engaged length, mm                   v      feed, mm/s
//   T      torque, N·mm                         tau_s  stall torque, N·mm
//
//   case                       against the feed        across the feed   T
//   cylinder, feed _|_ axis    u v L / (4 alpha N)     u v L / (4 N)     u v R L / (pi N)
//   ball, feed _|_ axis        pi u v R / (8 alpha N)  u v R / (2 N)     u v R² / (2 N)
//   flat end, feed along -z    u v R / (alpha N)       0                 u v R² / (2 N)
//
// "Across" points along z_B x v for a clockwise bur (z_B tip to shank), reversed otherwise. In the
// ball's row the whole sphere grinds. All functions throw Error if a quantity that must be positive
// is not.
#pragma once

#include <optional>

#include "toothprep/step/core/parameters.h"

namespace toothprep::reference {

struct SteadyLoad {  // of a bur that feeds steadily, fully in one tissue
  double against;    // N, opposite to the feed
  double across;     // N
  double torque;     // N·mm
};

struct Grinding {          // of that tissue
  double specific_energy;  // u, N/mm²
  double force_ratio;      // alpha
  double rotation_rate;    // N, rev/s
};

// radius and length in mm, speed in mm/s; the equations stand in data/physics.md.
[[nodiscard]] SteadyLoad cylinder_side_feed(const Grinding& g, double radius, double length,
                                            double speed);
[[nodiscard]] SteadyLoad ball_side_feed(const Grinding& g, double radius, double speed);
[[nodiscard]] SteadyLoad flat_end_plunge(const Grinding& g, double radius, double speed);

// A cylinder in side feed by a law beyond the paper's (step/grinding/grinding_law.h), its front
// engaged from the angle `from` to `to` about the feed (rad, within a quarter turn either way;
// positive angles lie where the rim goes with the feed): quadrature of
//   against = L int (f_n cos + f_t sin) dphi,  across = L int (f_t cos - f_n sin) dphi,
//   T = L R int f_t dphi,   at the advance v cos(phi), with f_t and f_n the force per dphi dl.
[[nodiscard]] SteadyLoad cylinder_by_law(const GrindingProperties& law, double rotation_rate,
                                         double radius, double length, double speed,
                                         double from = -1.5707963267948966,
                                         double to = 1.5707963267948966);

// Feed speed at which the cylinder's torque reaches tau_s, mm/s: tau_s pi N / (u R L); and its load
// there, which no longer knows u, N or L: against = tau_s pi / (4 alpha R).
[[nodiscard]] double cylinder_stall_speed(const Grinding& g, double radius, double length,
                                          double stall_torque);
[[nodiscard]] SteadyLoad cylinder_at_stall(double force_ratio, double radius, double stall_torque);

// A turbine that droops linearly, N = N0 (1 - T / tau_s); its greatest power is pi N0 tau_s / 2.
struct OperatingPoint {
  double torque;         // N·mm
  double rotation_rate;  // rev/s
};
[[nodiscard]] double droop_greatest_power(double idle_rate, double stall_torque);  // N·mm/s

// Imposed feed: tissue of specific energy u is removed at Q mm³/s, so 2 pi N T = u Q:
//   T = tau_s / 2 (1 - sqrt(1 - u Q / P_max)),   P_max = pi N0 tau_s / 2.
// Nothing above P_max: there the turbine collapses (at tau_s / 2 and N0 / 2).
[[nodiscard]] std::optional<OperatingPoint> droop_imposed_feed(double idle_rate,
                                                               double stall_torque,
                                                               double removal_power);

// Imposed force: force and torque are both proportional to v / N, so the torque follows from the
// force alone, whatever N is; the feed is then proportional to N. Nothing if the torque is tau_s or
// more: the bur stalls.
[[nodiscard]] std::optional<OperatingPoint> droop_imposed_torque(double idle_rate,
                                                                 double stall_torque,
                                                                 double torque);

// The same for a cylinder pressed into tissue with `against` newtons against its feed:
//   T = 4 alpha R / pi · F,  v = 4 alpha N F / (u L). The feed is greatest at T = tau_s / 2.
struct FeedUnderForce {
  OperatingPoint point;  // where the turbine runs
  double speed;          // mm/s
};
// g.rotation_rate is the idle rate N0.
[[nodiscard]] std::optional<FeedUnderForce> droop_cylinder_under_force(const Grinding& g,
                                                                       double stall_torque,
                                                                       double radius, double length,
                                                                       double against);

}  // namespace toothprep::reference
