// How far a coupled bur's force rises before the bur has gone through a layer.
//
// A bur hangs on a spring k and is fed into a layer at a constant speed of the handle. Its force
// rises towards that of direct drive, |B v|, and ends where the bur meets what lies beneath. Written
// in lengths of the bur and times of length / speed, the equation of coupled_feed.h has one number
// left besides the shape: k times length over the resistance B times speed. So for a given bur,
// layer and speed the share depends on k / B alone, B in proportion to u / (alpha N) and, for a
// cylinder fed across its axis, to the length that is engaged.
#pragma once

#include "toothprep/proof/reference/coupled_feed.h"

namespace toothprep::reference {

// |F| where the foremost point of the bur is `depth` (mm) deep, over |F| of direct drive there.
// `start`: the tip where the bur touches the top face, upright (its axis is z, `scene`'s block
// as in straight_feed.h), y the way from the tip to the foremost point, mm. `speed` of the handle,
// mm/s along -y; `stiffness` k, N/mm. The whole block counts as enamel. Throws Error if an argument
// is not positive, or the block is no deeper than `depth`.
[[nodiscard]] double share_of_plateau(const Scene& scene, const Vec3& start, double depth,
                                      double speed, double stiffness);

}  // namespace toothprep::reference
