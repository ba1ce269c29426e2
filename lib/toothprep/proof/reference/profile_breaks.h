// Where along a profile piece the shape of the contact changes. The contact is bounded by planes
// (the block's faces, the tissue border) and by the silhouette v·n = 0; as a function of the
// position along the piece, its extent in phi has kinks where
//   - the circle of revolution touches a plane:             A r ± = d - a_z z,
//   - two planes' edge pierces the surface,
//   - the silhouette begins or ends:                        |n_r| |v_h| = |n_z v_z|,
//   - the silhouette crosses a plane.
// Between such positions the integrand is smooth but for square roots at the ends, so that a
// quadrature that splits there converges at full speed. A kink that is missed (two roots closer
// than the bracketing of the general cases) costs time in the adaptive quadrature, not accuracy.
#pragma once

#include <vector>

#include "toothprep/step/bur/profile.h"
#include "toothprep/step/core/geometry.h"

namespace toothprep::reference {

// A half space { x : a·x <= d } in B, with what the circles of revolution see of it.
struct HalfSpace {
  HalfSpace() = default;
  HalfSpace(const Vec3& normal, double offset);

  Vec3 a = Vec3::Zero();  // unit
  double d = 0;           // mm
  double across = 0;      // A, length of a's part perpendicular to the axis; exactly 0 if tiny
  double phi = 0;         // its angle
};

// Fractions (0 to 1) of the piece's parameter at which the contact's shape changes, both ends
// included, in order. `feed` is the feed's direction in B, not necessarily a unit vector.
std::vector<double> contact_breaks(const ProfilePiece& piece, const std::vector<HalfSpace>& planes,
                                   const Vec3& feed);

}  // namespace toothprep::reference
