// Where rendering a linear resistance stays stable: the experiment of linear_damper_loop.h over a
// grid, and the analytic limits to draw beside it.
//
//   M total mass (arm and hand), T tick, d delay in ticks, D encoder count, v speed, f_c friction
//
//   linear_damping_limit        B = (2 M/T) tan(pi/(4 (d + 1)))
//       Mass and sampled damper alone: M (v_n+1 - v_n) = -B T (v_n-d + v_n-d-1)/2 has the
//       characteristic equation z^(d+1) (z - 1)/(z + 1) = -B T/(2 M), on whose unit circle
//       (z - 1)/(z + 1) = j tan(arg z/2). B T/M = 2, 0.828, 0.536 for d = 0, 1, 2. Above it the
//       loop diverges whatever the encoder; the hand's damping and spring shift it a little.
//   quantisation_damping_limit  B = M v/D
//       Each count gives the impulse B D; above the limit it exceeds the momentum M v, and a handle
//       without friction and without a hand would turn back.
//   friction_damping_limit      B = 2 f_c T/D
//       A hand that pulls slowly pulls with f_c; to drive the handle back against it, the pulse of
//       one count, B D/T, must also overcome the friction that then acts the other way. The bound
//       of stable rendering at slow speed; at higher speed momentum adds to it.
//   coupling_stiffness_limit    k = 2 b/T
//       A sampled spring (the coupling, when the bur is held by the tooth) gains k T/2 of negative
//       damping; b is that of arm and hand together. For masses that are large, k T²/M << 1.
//   friction_stiffness_limit    k = 2 f_c/D
//       The same for the step of one count, k D, when the tooth holds the bur. Above both limits of
//       k the spring can keep an oscillation going, below either of them the device damps it.
#pragma once

#include <cstddef>
#include <vector>

#include "toothprep/tools/device/linear_damper_loop.h"

namespace toothprep {

double linear_damping_limit(double mass, double time_step, int delay_ticks);             // N·s/mm
double quantisation_damping_limit(double mass, double speed, double encoder_count);      // N·s/mm
double friction_damping_limit(double friction, double time_step, double encoder_count);  // N·s/mm
double coupling_stiffness_limit(double damping, double time_step);                       // N/mm
double friction_stiffness_limit(double friction, double encoder_count);                  // N/mm

enum class MapAxis { kApparentMass, kCouplingStiffness };

struct StabilityMap {
  std::vector<double> dampings;            // B, N·s/mm
  MapAxis axis = MapAxis::kApparentMass;   // of `others`
  std::vector<double> others;              // m, N·s²/mm, or k, N/mm
  std::vector<ClosedLoopFigures> figures;  // others.size() rows of dampings.size() cells

  const ClosedLoopFigures& at(std::size_t other, std::size_t damping) const {
    return figures[other * dampings.size() + damping];
  }
};

// `base` with each pair of values in place of its own; cells are computed in parallel and do not
// depend on the number of threads. Throws Error for an empty axis, for a coupling stiffness in
// direct rendering, and as run_linear_damper() does.
StabilityMap stability_map(const LinearDamperExperiment& base, const std::vector<double>& dampings,
                           MapAxis axis, const std::vector<double>& others);

}  // namespace toothprep
