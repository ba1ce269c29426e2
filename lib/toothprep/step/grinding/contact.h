// Contact of the level-set engine: which elements of the bur's surface touch tissue, and how much
// of each. The law that they follow stands in contact_set.h.
//
// An element is in contact where tissue is met a small reach ahead of the surface, along the element's
// own velocity: ahead of fresh tissue that is the same as along the normal, and in a slot that is
// passed again it stays in the void instead of touching the walls. An element that a surface
// crosses (of the tooth, of the cut, of the border of two tissues) counts by the share of its
// extent that lies inside: the plane through the sample, by the field's gradient.
//
// Interpolated on the lattice, the wall that a convex bur left stands up to D²/8 times its
// curvature too far out. As much is taken off before a wall counts as touched.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/parameters.h"
#include "toothprep/step/grinding/contact_set.h"
#include "toothprep/step/grinding/workpiece.h"

namespace toothprep {

class ContactModel {
 public:
  // Elements of at most `element_size` mm; u and alpha per tissue (validated by the caller).
  ContactModel(const Bur& bur, double element_size, bool clockwise,
               const PerTissue<GrindingProperties>& tissue);

  // Finds the elements in contact for a bur at `pose` that moves with trial velocity v (mm/s, B,
  // not zero unless omega turns it) and turns with omega (rad/s, B). `reach` in mm. Elements that
  // face away from the motion by more than a margin of 8° are left out; see covers(). Allocates
  // nothing.
  void sample(const Workpiece& workpiece, const Pose& pose, const Vec3& v, const Vec3& omega,
              double reach) noexcept;

  // Whether every element that advances with v was considered by the last sample(), as far as the
  // direction of v goes (omega is the handle's and doesn't change within a step).
  bool covers(const Vec3& v) const noexcept;

  // What the last sample() found.
  const ContactSet& contact() const { return contact_; }

  struct IndexFrame;

 private:
  // The passes of sample(); see there.
  int locate_straight(const IndexFrame& frame, const Vec3& v, double reach) noexcept;
  int locate_turning(const IndexFrame& frame, const Vec3& v, const Vec3& omega,
                     double reach) noexcept;
  void cover(const float* to_index, float wall_per_curvature, int begin, int end) noexcept;
  void add_contact(int i, const PerTissue<float>& share) noexcept;
  // How a surface that the bur didn't cut crosses element i: the share inside of the field, `s` of
  // which is its sample (ox, oy, oz) ahead of the surface in index space, with the element's
  // curvature.
  float coverage_at_skin(FieldSample s, int i, const float* to_index, float ox, float oy,
                         float oz) const noexcept;
  // How element i is shared among the tissues; adds up to 1, or to 0 in air.
  void tissue_shares(const Workpiece& workpiece, std::size_t brick, const Index3& cell, float fx,
                     float fy, float fz, int i, const float* to_index, float ox, float oy, float oz,
                     PerTissue<float>& share) const noexcept;

  SurfaceElements elements_;
  ContactSet contact_;

  // Everything below is an array over the elements, so that the passes of a sample run in place and
  // side by side. Fixed:
  std::vector<float> mx_, my_, mz_;  // r x n, mm
  std::vector<float> chord_;         // see ContactSet::Element
  std::vector<float> curvature_;     // sum of the principal curvatures, 1/mm
  std::vector<float> sag_;  // mm, how far the element's rim lies behind its tangent plane: a wall
                            // of the same curvature or less that only touches it doesn't cross it
  // Of a sample: the cell (voxel of its lower corner, from the tip's voxel) and the place in it,
  // the cut's values at its corners, and the share of the element that the cut left.
  std::vector<std::int32_t> cell_x_, cell_y_, cell_z_;
  std::vector<float> fx_, fy_, fz_;
  std::array<std::vector<float>, 8> corner_;
  std::vector<float> covered_;
  std::vector<std::int32_t> candidates_;
  Vec3 sampled_direction_ = Vec3::Zero();
};

// Area of the shank in contact with tissue, mm²: reported only.
double shank_contact_area(const SurfaceElements& shank, const Workpiece& workpiece,
                          const Pose& pose) noexcept;

}  // namespace toothprep
