// Contact and force of the level-set engine.
//
// The law (the paper's Eqs 6-9 and 14). Each surface element that advances into tissue k takes the
// power u_k (v·n) ds. With the rim speed 2 pi N r this is a tangential force along n_t, and through
// alpha_k = F_t / F_n a normal force against n_n; with ds = r dphi dl
//
//   dF   = u_k / (2 pi N) · (v·n) · (n_t - n_n / alpha_k) dphi dl          N
//   dT_z = u_k / (2 pi N) · (v·n) · r dphi dl                             N·mm
//
// so that, summed over the advancing elements, F = B v + C omega and T = b·v + c·omega.
//
//   symbol      here                         unit        frame
//   v           feed velocity of the tip     mm/s        B
//   omega       rotation of the handle       rad/s       B    v(s) = v + omega x r(s)
//   n_n, n_t    SurfaceElements n, t         1           B
//   dphi dl     SurfaceElements weight       mm          (= ds / r)
//   u, alpha    GrindingProperties           N/mm², 1
//   N           rotation rate                rev/s       responses are for N = 1 rev/s: divide by N
//   B           Response::B                  N·s/mm · rev/s
//
// An element is in contact where tissue is met a small reach ahead of the skin, along the element's
// own velocity: ahead of fresh tissue that is the same as along the normal, and in a slot that is
// passed again it stays in the void instead of touching the walls. An element that a surface
// crosses (of the tooth, of the cut, of the border of two tissues) counts by the share of its
// extent that lies inside: the plane through the sample, by the field's gradient.
//
// Interpolated on the lattice, the wall that a convex bur left stands up to D²/8 times its
// curvature too far out. As much is taken off before a wall counts as touched.
//
// Valid while the bur turns much faster than it feeds, so that the chip thickness doesn't depend on
// phi.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "toothprep/bur/bur.h"
#include "toothprep/core/parameters.h"
#include "toothprep/grinding/workpiece.h"

namespace toothprep {

// Which elements in contact advance, told by their number and the sum of their places: what changes
// from one trial velocity to the next are neighbours at the border of the set, and that changes one
// of the two.
struct AdvancingSet {
  std::int32_t count = 0, places = 0;
  bool operator==(const AdvancingSet&) const = default;
};

// The linear response of the contact to the feed, for the advancing set of one trial velocity, in
// B, for N = 1 rev/s: F = (B v + f0) / N, T = (b·v + t0) / N, with f0 and t0 from the handle's
// rotation.
struct GrindingResponse {
  Mat3 B = Mat3::Zero();
  Vec3 f0 = Vec3::Zero();
  Vec3 b = Vec3::Zero();
  double t0 = 0;
  AdvancingSet set;
};

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

  // The response with the advancing set {v·n + omega·(r x n) > 0}.
  GrindingResponse response(const Vec3& v, const Vec3& omega) const noexcept;
  AdvancingSet advancing_set(const Vec3& v, const Vec3& omega) const noexcept;
  // Advancing contact area per tissue, mm².
  PerTissue<double> advancing_area(const Vec3& v, const Vec3& omega) const noexcept;
  // Whether any element in contact advances.
  bool any_advances(const Vec3& v, const Vec3& omega) const noexcept;

  struct IndexFrame;

 private:
  // The passes of sample(); see there.
  int locate_straight(const IndexFrame& frame, const Vec3& v, double reach) noexcept;
  int locate_turning(const IndexFrame& frame, const Vec3& v, const Vec3& omega,
                     double reach) noexcept;
  void cover(const float* to_index, float wall_per_curvature, int begin, int end) noexcept;
  void add_contact(int i, const PerTissue<float>& share) noexcept;
  // How a surface that the bur didn't cut crosses element i: the share inside of the field, `s` of
  // which is its sample (ox, oy, oz) ahead of the skin in index space, with the element's
  // curvature.
  float coverage_at_skin(FieldSample s, int i, const float* to_index, float ox, float oy,
                         float oz) const noexcept;
  // How element i is shared among the tissues; adds up to 1, or to 0 in air.
  void tissue_shares(const Workpiece& workpiece, std::size_t brick, const Index3& cell, float fx,
                     float fy, float fz, int i, const float* to_index, float ox, float oy, float oz,
                     PerTissue<float>& share) const noexcept;

  SurfaceElements elements_;
  PerTissue<float> ct_{}, cn_{};  // u/(2 pi), u/(2 pi alpha)

  // Everything below is an array over the elements, so that the passes of a sample run in place and
  // side by side. Fixed:
  std::vector<float> mx_, my_, mz_;  // r x n, mm
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
  // The elements in contact, one after the other: normal, r x n, force per advance (coefficients of
  // n_t and n_n summed), torque per advance, area per tissue.
  int count_ = 0;
  struct {
    std::vector<float> nx, ny, nz, mx, my, mz, qx, qy, qz, torque;
    std::vector<PerTissue<float>> area;
  } contact_;
};

// Area of the shank in contact with tissue, mm²: reported only.
double shank_contact_area(const SurfaceElements& shank, const Workpiece& workpiece,
                          const Pose& pose) noexcept;

}  // namespace toothprep
