// Inside of the module: the cavity's parts, in the frame (u, v, w) of cavity.h.
#pragma once

#include <vector>

#include "toothprep/proof/specimen/cavity.h"
#include "toothprep/proof/specimen/convex_polyhedron.h"

namespace toothprep {

// Point of the tooth's frame (x, y, z) as (u, v, w).
inline Vec3 uvw(const Vec3& x) { return {x.x(), -x.z(), x.y()}; }

// Signed distance to a rectangle of half sides `half` about the origin, exact.
double rectangle_distance(double u, double v, double half_u, double half_v);

// A prism or stump in plan: a rectangle grown by `round`.
struct Plan {
  double half_u = 0, half_v = 0, round = 0;  // the rectangle's half sides, and the growth
};
Plan tooth_plan(const CavityOptions& options);
Plan stump_plan(const CavityOptions& options);  // at the level of the shoulder
// Whether a stump's edge is rounded or its shoulder is rounded or slopes.
inline bool has_shaped_profile(const CavityOptions& o) {
  return o.occlusal_radius > 0 || o.shoulder_radius > 0 || o.shoulder_slope > 0;
}

double tooth_distance(const CavityOptions& options, const Vec3& p);
ConvexPolyhedron pulp_box(const CavityOptions& options);  // options.pulp_depth must be there
ConvexPolyhedron neighbour_box(
    const CavityOptions& options);  // options.neighbour_gap must be there

// The polyhedra that a box or class II cavity is the union of, without offset. They run on above
// the top face, and those of class II run on beyond the side to u = `end`. With a bow the floor is
// left away: the polyhedron runs on below it.
std::vector<ConvexPolyhedron> cavity_parts(const CavityOptions& options, double end);
double side_end(const CavityOptions& options);    // `end` well beyond the tooth's side
double damage_end(const CavityOptions& options);  // `end` as deep in the neighbour as damage runs

double tan_degree(double degrees);

// Height of a box's floor, without offset.
double floor_height(const CavityOptions& options, double u, double v);
// Where a bowed floor meets the end walls: u of the lower and of the upper end. NaN: it doesn't.
struct FloorEnds {
  double low = 0, high = 0;
};
FloorEnds bowed_floor_ends(const CavityOptions& options);
// The floor of a box or class II cavity (there only up to the axial wall) as a polygon; flat ones,
// with the offset.
std::vector<Vec3> flat_floor(const CavityOptions& options);

// How near the walls of a stump come to its pulp, without offset; negative: they cut it.
double stump_wall_to_pulp(const CavityOptions& options);

// Signed distance to the cavity with its offset.
class CavityShape {
 public:
  CavityShape(const CavityOptions& options, double end);
  double distance(const Vec3& p) const;

 private:
  CavityOptions options_;
  std::vector<ConvexPolyhedron> parts_;
  Plan stump_;
};

}  // namespace toothprep
