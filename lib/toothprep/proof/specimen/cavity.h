// Exact test preparations: a tooth before and after a cavity, whose every figure is known in closed
// form. With them a scorer can be checked by anyone.
//
// Frame. The tooth stands in its own frame with its top face at y = 0, the opening towards +y. In
// that frame u = +x (length, "mesial"), v = -z (width, "buccal"), w = +y (out of the tooth,
// "occlusal"); u, v, w are right-handed. `pose` takes the frame to W. All lengths in mm, angles in
// degrees.
//
//   original   a prism size.x by size.z in plan, size.y high, its vertical edges rounded by
//              `corner` (half the smaller side: a cylinder if size.x = size.z); enamel above
//              y = -enamel, dentin below, in it optionally a box of pulp; beside it optionally a
//              neighbour.
//   kBox       a box cavity. A wall lies at  +-length/2 + (w + depth) tan(taper)  from the middle,
//              so that `length` and `width` hold at the level of the floor's centre, w = -depth; a
//              positive taper opens towards the occlusal, a negative one is an undercut. The floor
//              is  w = -depth + u tan(floor_tilt_u) + v tan(floor_tilt_v),  or, bowed,
//              w = -depth + bow (2u/length)²: a parabolic cylinder, deepest in the middle by `bow`
//              (its sagitta over the nominal length; negative: a hump).
//   kClass2    that box, open towards +u, and a proximal box: gingival floor at w =
//              -gingival_depth, `axial_depth` from the tooth's side to the axial wall at that
//              floor, `proximal_width` across at that floor. `length` is that of the pulpal floor
//              up to the axial wall; `width` is the isthmus. The middle of the box is not the
//              tooth's: tilt is about the tooth's middle.
//   kStump     all above the shoulder is removed but a core: flat top at w = -occlusal_reduction,
//              shoulder at w = -shoulder_level, `shoulder_width` inside the tooth's outline at
//              that level, walls that converge by convergence_u and convergence_v in all (both
//              walls together; negative: undercut), vertical edges rounded by stump_corner at the
//              level of the shoulder. Rounded walls are cones with vertical axes, which needs the
//              same convergence in u and v. The edge of its top may be rounded by occlusal_radius,
//              the line angle of its shoulder by shoulder_radius (in a plane across the wall; where
//              that is more than the shoulder is wide, the finish line lies on the arc, above
//              shoulder_level), and the shoulder may fall outwards by shoulder_slope.
//   offset     grows the cavity by that distance on all sides: the set of points nearer to it than
//              `offset`, whose surface is rounded along the cavity's outer line angles. The
//              cavity without it is its target, and the distance from any point of the cut surface
//              to the target's is `offset` (but for a strip of offset·sin(taper) at the margin).
//
// What is exact: the zero sets, everywhere. cavity_distance() is the Euclidean distance outside the
// cavity (in what remains of the tooth), so also round line angles; inside it is a lower bound in
// size, less than the distance only beside convex edges of what remains (the axiopulpal edge, the
// edges of a stump). With a bow it is the larger of the distances to walls and floor: outside the
// cavity, beside the floor's line angles, a lower bound. The remaining solid is max(original,
// -cavity): near its convex edges (the margin) it is a lower bound outside the tooth. So the slope
// is one wherever there is one.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

enum class CavityKind { kBox, kClass2, kStump };

struct CavityOptions {
  CavityKind kind = CavityKind::kBox;

  // The tooth
  Vec3 size{12, 8, 12};
  double corner = 0;
  double enamel = 1.4;
  double voxel = 0.1;
  Pose pose;
  std::optional<double> pulp_depth;  // from the top face to the roof of the pulp, >= enamel
  Vec3 pulp_size{3, 2, 2};           // along u, w (down from the roof) and v; in the middle
  std::optional<double>
      neighbour_gap;            // from the side +u to a neighbour, a box as large as the tooth
  double neighbour_damage = 0;  // how deep a class II box runs on into the neighbour

  // Box and class II
  double length = 4, width = 2.5, depth = 2;
  double taper_u_plus = 0, taper_u_minus = 0, taper_v_plus = 0, taper_v_minus = 0;  // (-30, 45)
  double floor_tilt_u = 0, floor_tilt_v = 0;  // positive: rises towards +u, +v; (-30, 30)
  double bow = 0;

  // Class II
  double proximal_width = 3.5, gingival_depth = 3.5, axial_depth = 1.5;
  double axial_taper = 0;     // positive: opens towards the occlusal
  double proximal_taper = 0;  // of the box's two side walls

  // Stump
  double occlusal_reduction = 1.5, shoulder_level = 5.5, shoulder_width = 1;
  double convergence_u = 10, convergence_v = 10;  // (-30, 60)
  std::optional<double> stump_corner;             // absent: max(0, corner - shoulder_width)
  double occlusal_radius = 0;                     // of the edge between top and walls
  double shoulder_radius = 0;  // of the line angle between walls and shoulder: a chamfer
  double shoulder_slope = 0;   // the shoulder falls outwards by that angle: a bevel; [0, 75)

  double offset = 0;  // 0 .. 1
};

// Throws Error naming the option and the condition: out of range, walls that meet above the floor,
// a cavity that leaves the tooth, a pulp in the enamel, combinations that are not offered (bow with
// tilt, offset or an exposed pulp; damage with offset).
void check_cavity(const CavityOptions& options);

struct CavitySpecimen {
  LayeredTooth original, prepared;  // one lattice, the same labels
};

// Bit for bit the same where nothing was cut. Provenance of both: `source`, `axis_occlusal`,
// `axis_mesial`, `axis_buccal` (unit vectors in W, "x y z").
CavitySpecimen make_cavity(const CavityOptions& options);

// Signed distance to the cavity at a point of W, mm, negative inside.
std::function<double(const Vec3&)> cavity_distance(const CavityOptions& options);

struct TruthFigure {
  std::string key;  // a dot makes a group: removed_mm3.enamel
  double value = 0;
};
using CavityTruth = std::vector<TruthFigure>;

// What a perfect scorer finds; keys as in score.json. Closed forms, but for volumes under a bowed
// floor or in an offset stump (quadrature to 1e-9) and the remaining dentin under a bowed floor
// (1e-6). Lengths are those between the planes of floor and walls, line angles not rounded.
//
//   removed_mm3.enamel|dentin|pulp|other|total, neighbour_damage_mm3; with offset also
//     required_mm3, removed_inside_mm3, over_prepared_mm3, under_prepared_mm3, dice,
//     deviation_mean_mm (negative: too much was taken), deviation_rms_mm, deviation_p95_mm, and of
//     a box hausdorff_mm. Volumes are left out for a class II with offset; single tissues where an
//     offset's rounded edges cross the enamel's border.
//   depth_mm: median of the vertical distance from the margin plane to the floor, over the floor's
//     area; depth_min_mm and depth_max_mm its 5 and 95 % values, depth_least_mm and
//     depth_greatest_mm its bounds, depth_centre_mm at u = v = 0; floor_tilt_deg,
//     floor_flatness_mm: of and about the best plane, by area in plan
//   wall_angles_deg.mesial (u+), .distal (u-), .buccal (v+), .lingual (v-), in class II also
//     .axial, .proximal_buccal, .proximal_lingual: against the axis, positive where the wall faces
//     the opening; convergence_deg.mesiodistal, .buccolingual, .mean: of opposite walls, positive
//     for a stump that narrows towards the occlusal, negative for a cavity that opens
//   length_mm, width_mm: at half the depth of the floor's centre, or half a stump's height;
//     length_floor_mm, width_floor_mm at the floor's centre; length_margin_mm, width_margin_mm at
//     the margin plane; length_shoulder_mm, length_top_mm (and width) of a stump
//   class II: isthmus_width_mm (= width_mm), box_width_mm (at half the box's depth),
//     box_width_floor_mm, gingival_depth_mm (from the margin plane), axial_wall_height_mm,
//     gingival_floor_tilt_deg, gingival_floor_flatness_mm, axial_depth_mm (from the tooth's side,
//     half-way between both floors), axial_depth_floor_mm, gingival_floor_width_mm (the same),
//     convergence_deg.proximal, axiopulpal_radius_mm, box_clearance_mm
//   box: marginal_ridge_mm, wall_thickness_min_mm: horizontal, of an even floor; box and class II:
//     line_angle_radius_mm
//   stump: margin_width_mm (of u and v the mean), wall_height_mm, occlusal_reduction_mm,
//     axial_reduction_mm.mesial|distal|buccal|lingual (horizontal, at half the wall's height),
//     line_angle_radius_mm, cavosurface_angle_deg, margin_form.shoulder|chamfer|bevel,
//     margin_gaps, margin_gap_longest_mm, occlusoaxial_radius_mm, occlusoaxial_angle_deg, and
//     where the stump's outline runs beside the tooth's, margin_width_min_mm, margin_width_max_mm,
//     occlusoaxial_radius_min_mm, finish_line_roughness_mm. With a rounded edge or shoulder or a
//     slope, volumes, wall_height_mm and axial reductions are left out
//   undercut_along_axis_mm, undercut_along_axis_area_mm2: how far a wall lies horizontally behind
//     the edge above it, and such walls' area; undercut_draws: 1 if a path of draw, maybe tilted,
//     frees all walls; undercut_max_mm, undercut_area_mm2 along the best path: none if it draws, as
//     along the axis if opposite walls are alike, left out otherwise
//   remaining_dentin_min_mm, pulp_exposed: with a pulp
CavityTruth cavity_truth(const CavityOptions& options);

std::optional<double> truth_value(const CavityTruth& truth, const std::string& key);

}  // namespace toothprep
