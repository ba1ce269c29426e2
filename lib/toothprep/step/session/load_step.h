// The imposed load: a weight or a hand pushes a bur without mass, and the grinding force balances it.
//
//   F + B v + f0 = 0                       free
//   d·(F + B v + f0) = 0,  v = s d         on a rail along d, which bears all across it
//
//   symbol  here         unit     frame
//   F       load         N        any, the same for all
//   v       the result   mm/s
//   B       resistance   N·s/mm   negative definite where the bur grinds; not symmetric
//   f0      f0           N        grinding force of the handle's rotation alone
//   c       drag         N·s/mm
//
// The contact is that at the start of the step and the velocity that at its end, as in the coupled
// drive; as no spring is stretched meanwhile, the step is exact for a contact that stays as it is.
//
// Where nothing resists - in the air, along a wall, along the bur's axis - v would have no bound.
// There the bur is slowed by a drag, B -> B - c I, with the smallest c >= 0 for which |v| is
// max_speed; c is 0 whenever the load is balanced below that speed. A free bur that touches one
// side only is pushed along it by the tangential force: cutting tests guide the handpiece on a sled.
#pragma once

#include "toothprep/step/core/geometry.h"

namespace toothprep {

// `rail`: zero, or the unit vector of the rail.
Vec3 load_velocity(double max_speed, const Vec3& rail, const Vec3& load, const Mat3& resistance,
                   const Vec3& f0) noexcept;

}  // namespace toothprep
