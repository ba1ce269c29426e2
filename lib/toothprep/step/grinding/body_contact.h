// How much of a bur's advancing contact lies in which body of a workpiece (workpiece_bodies.h).
//
// The contact's area as a whole is the force law's (contact_set.h); of it, what lies in bodies other
// than the tooth that is prepared is found here, by elements of 0.1 mm whose middle, a small reach
// ahead along the motion, lies in what remains of such a body. Elements in bricks that hold none are
// not looked at.
#pragma once

#include <array>
#include <cstdint>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/step_record.h"
#include "toothprep/step/grinding/workpiece.h"

namespace toothprep {

class BodyContact {
 public:
  explicit BodyContact(const Bur& bur);

  using Areas = std::array<BodyArea, kMostTouched>;

  // Of a bur at `pose` whose tip moves with v (mm/s, W) and which turns with omega (rad/s, W);
  // `total` is the whole advancing area, mm². The largest first; at most `total` together. All but
  // the tooth that is prepared; none if the workpiece has one body. Allocates nothing.
  Areas areas(const Workpiece& workpiece, const Pose& pose, const Vec3& v, const Vec3& omega,
              double total) const noexcept;

  // A bit (1 << place in the list) for each body, the prepared tooth too, that elements lie in (of
  // a shank, say; by the nearest voxel).
  static std::uint64_t touched_by(const SurfaceElements& elements, const Workpiece& workpiece,
                                  const Pose& pose) noexcept;

 private:
  SurfaceElements elements_;
  Vec3 middle_;    // of the head, mm, B
  double radius_;  // about it, mm
};

}  // namespace toothprep
