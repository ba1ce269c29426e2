// Virtual coupling and the backward Euler step of the bur (the paper's Eqs 12-18).
//
//   m dv/dt = F_VC + F_G,   F_VC = k (P_H - P) + b (v_H - v),   F_G = B v + f0
//
// The paper's 6x6 system in (dP, dv) reduces exactly to 3x3 with dP = h (v0 + dv):
//
//   [(m/h + h k + b) I - B] dv = F_VC(P0, v0) + B v0 + f0 - h k v0
//
//   symbol  here                 unit        frame
//   P, v    bur tip              mm, mm/s    any, the same for all
//   P_H     handle, this step    mm
//   v_H     (P_H,i - P_H,i-1)/h  mm/s
//   k, b    Coupling             N/mm, N·s/mm
//   m       bur_mass             N·s²/mm
//   B       resistance           N·s/mm      negative definite where the bur grinds; not symmetric
//   h       time step            s
//
// Backward Euler doesn't diverge at any h as long as the symmetric part of B is not positive; an
// isolated element's is (slightly), a symmetric contact's is not.
#pragma once

#include "toothprep/step/core/geometry.h"
#include "toothprep/step/core/parameters.h"

namespace toothprep {

struct CouplingState {
  Vec3 position;         // P0
  Vec3 velocity;         // v0
  Vec3 handle_position;  // P_H
  Vec3 handle_velocity;  // v_H
};

// F_VC at the given bur state, N, on the bur. The operator feels its negative.
inline Vec3 coupling_force(const Coupling& c, const CouplingState& s) noexcept {
  return c.stiffness * (s.handle_position - s.position) +
         c.damping * (s.handle_velocity - s.velocity);
}

// The velocity at the end of the step, mm/s.
Vec3 implicit_velocity(const Coupling& coupling, double time_step, const CouplingState& state,
                       const Mat3& resistance, const Vec3& f0) noexcept;

}  // namespace toothprep
