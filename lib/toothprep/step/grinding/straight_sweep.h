// A part of the bur's way along which it moved straight on and didn't lean otherwise: what it took there is known exactly,
// where the lattice rounds it. Turning about its own axis changes nothing.
#pragma once

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/geometry.h"
#include "toothprep/step/tooth/cut_way.h"

namespace toothprep {

struct StraightSweep : StraightPart {
  // Whether it leads on to `to` with no point of the bur's head off its line by more than `most_aside` (mm). If so it does
  // from here on.
  bool lead_on(const Bur& bur, const Pose& to, double most_aside) noexcept;
  // Whether a bur at `pose` is on that line again, to `aside` (mm), and moves along it with v (W, mm/s) through what it
  // took there, for at least that much way.
  [[nodiscard]] bool leads_through(const Bur& bur, const Pose& pose, const Vec3& v,
                                   double aside) const noexcept;
  // Whether it leads to where the bur is, to `aside` (mm), and goes on as the bur does, by a unit vector (W).
  [[nodiscard]] bool leads_to(const Bur& bur, const Pose& pose, const Vec3& direction,
                              double aside) const noexcept;
  // Whether it goes on from the part before it with hardly a bend.
  [[nodiscard]] bool follows(const StraightSweep& before) const noexcept;
  // Whether the way isn't square to the bur's axis, to 0.2 um.
  [[nodiscard]] bool leans() const noexcept;
  // Whether the bur, which has a convex head, was over a place (W, mm) there, deeper than `depth` (mm).
  [[nodiscard]] bool was_over(const Bur& bur, const Vec3& place, double depth) const noexcept;
};

}  // namespace toothprep
