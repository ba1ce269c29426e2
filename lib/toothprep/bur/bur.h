// The bur: a solid of revolution about its own +z (tip at the origin, shank up), its exact distance
// function and its surface cut into elements.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "toothprep/core/geometry.h"

namespace toothprep {

// One piece of the profile in the half plane (r, z), r >= 0, mm, run from the tip upwards along the
// outline (solid to the left when looking along +z from the axis: the outward normal is to the right of
// the direction of travel, i.e. for direction (dr, dz) it is (dz, -dr)).
// A straight line, or a circular arc about `centre`, convex or concave.
struct ProfilePiece {
  enum class Kind { kLine, kArc } kind = Kind::kLine;
  double r0 = 0, z0 = 0, r1 = 0, z1 = 0;    // end points
  double centre_r = 0, centre_z = 0;        // arcs only
  bool convex = true;                       // arcs only: the solid lies on the centre's side
  bool grinds = true;                       // false for the disc that closes the head at the shank
};

// The cut surface of the bur, one entry per element, all in B. Structure of arrays, rings from tip to
// shank, each ring in order of the angle, so that neighbours in memory are neighbours in space.
//
//   position x  mm        centre of the element, on the surface
//   normal n    unit      n_n: outward
//   tangent t   unit      n_t: opposite to the surface velocity; +phi^ for a clockwise bur (Eq. 7),
//                         (0, 0, 0) never occurs: elements on the axis do not exist
//   weight      mm        dphi·dl = ds/r: the factor of Eqs 8 and 14, finite at the axis
//   area        mm²       ds
//   radius      mm        distance from the axis
//   half_along  mm        half the extent along the profile; half_around: half the extent r·dphi
struct SurfaceElements {
  std::vector<float> x, y, z, nx, ny, nz, tx, ty;  // tz = 0
  std::vector<float> weight, area, radius, half_along, half_around;
  // Along-profile unit tangent = t x n up to sign; kept for the coverage of partly engaged elements.
  std::vector<float> lx, ly, lz;
  std::size_t size() const { return x.size(); }
};

class Bur {
 public:
  // Pieces joined end to end from (0, 0) to (0, z_top), closing the head. Throws Error naming the
  // violated condition (gap, r < 0, not closed, self-crossing, not finite, radius above 10 mm ...).
  Bur(std::string name, std::vector<ProfilePiece> head, double shank_radius, double shank_top);

  const std::string& name() const { return name_; }
  const std::vector<ProfilePiece>& profile() const { return head_; }
  double head_length() const { return head_length_; }  // largest z of the head, mm
  double max_radius() const { return max_radius_; }    // largest r of the head, mm
  double shank_radius() const { return shank_radius_; }  // 0: no shank
  double shank_top() const { return shank_top_; }        // z where the shank ends, mm

  // Exact signed distance to the head's surface, mm, negative inside. r >= 0.
  double distance(double r, double z) const;
  // The same for n points, written for the compiler's vectoriser: the step's removal calls it for rows
  // of voxels. Within float rounding of distance().
  void distances(const float* r, const float* z, float* out, int n) const noexcept;

  double head_volume() const;        // mm³, exact
  double grinding_area() const;      // mm², exact (pieces with grinds)

  // Elements of at most `size` mm along and around, of the grinding surface; the shank's surface in
  // shank_elements (a plain cylinder from the head's end to shank_top, for contact reporting only).
  // `clockwise` (seen from the shank) sets the sign of the tangent.
  SurfaceElements elements(double size, bool clockwise = true) const;
  SurfaceElements shank_elements(double size) const;

 private:
  std::string name_;
  std::vector<ProfilePiece> head_;
  double shank_radius_, shank_top_, head_length_ = 0, max_radius_ = 0;
};

}  // namespace toothprep
