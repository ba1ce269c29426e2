// The bur: a solid of revolution about its own +z (tip at the origin, shank up), its exact distance
// function and its surface cut into elements.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "toothprep/step/bur/profile.h"
#include "toothprep/step/core/geometry.h"

namespace toothprep {

// The cut surface of the bur, one entry per element, all in B. Structure of arrays, rings from tip
// to shank, each ring in order of the angle, so that neighbours in memory are neighbours in space.
//
//   position x  mm        centre of the element, on the surface
//   normal n    unit      n_n: outward
//   tangent t   unit      n_t: opposite to the surface velocity; +phi^ for a clockwise bur (Eq. 7),
//                         (0, 0, 0) never occurs: elements on the axis do not exist
//   weight      mm        dphi·dl = ds/r: the factor of Eqs 8 and 14, finite at the axis
//   area        mm²       ds
//   radius      mm        distance from the axis
//   half_along  mm        half the extent along the profile; half_around: half the extent r·dphi
//   curvature_along, curvature_around   1/mm, principal curvatures, positive where convex
struct SurfaceElements {
  std::vector<float> x, y, z, nx, ny, nz, tx, ty;                    // as above; tz = 0
  std::vector<float> weight, area, radius, half_along, half_around;  // as above
  // Along-profile unit tangent, tip to shank: n x phi^; kept for the coverage of partly engaged
  // elements.
  std::vector<float> lx, ly, lz;
  std::vector<float> curvature_along, curvature_around;  // as above
  std::size_t size() const { return x.size(); }          // number of elements
};

// The outline laid out for the distance kernels (bur_distance.cpp), in double and in float.
template <class T>
struct DistanceOutline {
  struct Line {  // oriented upwards: `left of it` is where the crossing test counts
    T mid_r, mid_z, u_r, u_z, half_length, z_low, z_high;  // middle, direction, extent; mm
  };
  struct Arc {  // within the right or the left half of its circle, hence monotone in z
    T mid_r, mid_z, out_r, out_z, curvature;   // middle, unit direction from the centre, 1 / radius
    T from_r, from_z, from_out_r, from_out_z;  // ends, counter-clockwise, and their unit directions
    T to_r, to_z, to_out_r, to_out_z;          // as `from_...`, of the other end
    T centre_r, centre_z, z_low, z_high;       // mm
  };
  struct Point {  // a joint of the outline
    T r, z;       // mm
  };
  struct Corner {                  // a sharp edge
    T r, z;                        // mm
    T from_r, from_z, to_r, to_z;  // unit directions of travel before and behind it
  };
  std::vector<Line> lines;                 // all straight pieces
  std::vector<Arc> right_arcs, left_arcs;  // by the half of the circle that they lie in
  std::vector<Point> points;               // joints that no line ends in
  std::vector<Corner> corners;             // to be mitred
};

// Where points lie that are asked for together.
struct DistanceBall {
  float r, z, radius;  // mm
};
// A block of a lattice, whose points these are:
constexpr int kBlockEdge = 4;                                         // voxels along each axis
constexpr int kDistanceBlock = kBlockEdge * kBlockEdge * kBlockEdge;  // points

// Of such a block the points' distances r from the bur's axis and places z along it, mm: point (i, j, k), k
// fastest, lies at to_bur (first + (i, j, k)), B. `first` in voxels; `to_bur` in mm per voxel, row by row.
void places_of_block(const float* to_bur, const float* first, float* r, float* z) noexcept;

class Bur {  // immutable; lengths in mm, frame B; may be read from several threads
 public:
  // Pieces joined end to end from (0, 0) to (0, z_top), closing the head. Throws Error naming the
  // violated condition (gap, r < 0, not closed, self-crossing, not finite, radius above 10 mm ...).
  // shank_radius 0: no shank; else shank_top must lie above the head.
  Bur(std::string name, std::vector<ProfilePiece> head, double shank_radius, double shank_top);

  const std::string& name() const { return name_; }  // as given: what traces call it
  const std::vector<ProfilePiece>& profile() const { return head_; }  // checked outline, tip first
  double head_length() const { return head_length_; }                 // largest z of the head, mm
  double max_radius() const { return max_radius_; }                   // largest r of the head, mm
  double shank_radius() const { return shank_radius_; }               // 0: no shank
  double shank_top() const { return shank_top_; }                     // z where the shank ends, mm

  // Exact signed distance to the head's surface (closing disc included), mm, negative inside. r >=
  // 0.
  [[nodiscard]] double distance(double r, double z) const noexcept;
  // What removal carves by, mm, for n points: within float rounding of distance(), but mitred
  // outside of sharp edges: there it is the larger of the distances from the planes of the edge's
  // two faces. That is 0 where the distance is, and rises as slowly outside of the edge as it does
  // inside, so that what is interpolated between voxels errs to neither side. The value of a point
  // doesn't depend on its neighbours.
  void mitred_distances(const float* r, const float* z, float* out, int n) const noexcept;
  // The same values of kDistanceBlock points in a ball, the faster the smaller it is.
  void mitred_distances_near(const DistanceBall& ball, const float* r, const float* z,
                             float* out) const noexcept;

  [[nodiscard]] double head_volume() const;    // mm³, exact
  [[nodiscard]] double grinding_area() const;  // mm², exact (pieces with grinds)

  // Elements of at most `size` mm along and around, of the grinding surface; the shank's surface in
  // shank_elements (a plain cylinder from the head's end to shank_top, for contact reporting only).
  // A ring has a multiple of four elements, at least eight, so that a quarter turn maps the set
  // onto itself to the last bit; successive rings are staggered. `clockwise` (seen from the shank)
  // sets the sign of the tangent. Throws Error if `size` is not within 1e-4 .. 10 mm or would need
  // more than 20 million elements.
  [[nodiscard]] SurfaceElements elements(double size, bool clockwise = true) const;
  [[nodiscard]] SurfaceElements shank_elements(double size) const;

 private:
  std::string name_;
  std::vector<ProfilePiece> head_;
  double shank_radius_, shank_top_, head_length_ = 0, max_radius_ = 0;
  DistanceOutline<double> exact_;
  DistanceOutline<float> fast_;
};

}  // namespace toothprep
