// The outline of a solid of revolution in the half plane (r, z), r >= 0, mm: lines and circular
// arcs, and the integrals along them that have a closed form.
#pragma once

#include <string>
#include <vector>

namespace toothprep {

// One piece of the profile, run from the tip upwards along the outline with the solid to the left:
// for the direction of travel (dr, dz) the outward normal is (dz, -dr). A straight line, or a
// circular arc about `centre`: convex arcs run counter-clockwise in (r, z), concave ones clockwise,
// so the two ends and the centre say which of the circle's two arcs is meant.
struct ProfilePiece {
  enum class Kind { kLine, kArc } kind = Kind::kLine;  // straight, or about `centre`
  double r0 = 0, z0 = 0, r1 = 0, z1 = 0;               // end points
  double centre_r = 0, centre_z = 0;                   // arcs only
  bool convex = true;  // arcs only: the solid lies on the centre's side
  bool grinds = true;  // false for the disc that closes the head at the shank
};

// Shorthands for building profiles.
[[nodiscard]] ProfilePiece line_piece(double r0, double z0, double r1, double z1,
                                      bool grinds = true);
[[nodiscard]] ProfilePiece arc_piece(double r0, double z0, double r1, double z1, double centre_r,
                                     double centre_z, bool convex = true, bool grinds = true);

// An arc's radius in mm, the angle of its start about the centre, and the signed angle it sweeps,
// rad: in (0, 2 pi) if convex, in (-2 pi, 0) if concave.
struct ArcSpan {
  double radius, start, sweep;  // mm, rad, rad
};
[[nodiscard]] ArcSpan arc_span(const ProfilePiece& arc);  // of a piece of kind kArc

struct ProfilePoint {       // a place on the outline
  double r, z;              // mm
  double along_r, along_z;  // unit direction of travel; the outward normal is (along_z, -along_r)
};
// The point at `fraction` (0 to 1) of the piece's length.
[[nodiscard]] ProfilePoint point_on(const ProfilePiece& piece, double fraction);

// Whether the outline only turns left, from at least level at the tip to at least level at the other
// end.
[[nodiscard]] bool is_convex(const std::vector<ProfilePiece>& outline);

// Where the outline turns outwards, between two pieces that grind.
struct SharpEdge {
  ProfilePoint before, after;  // at the one place, along the piece before it and the one behind it
};
// Those that turn by more than asin(least_sine).
[[nodiscard]] std::vector<SharpEdge> sharp_edges(const std::vector<ProfilePiece>& outline,
                                                 double least_sine = 0.05);

struct ProfileBounds {                // the rectangle around a piece
  double r_min, r_max, z_min, z_max;  // mm
};
[[nodiscard]] ProfileBounds bounds_of(const ProfilePiece& piece);  // exact, arcs too

[[nodiscard]] double length_of(const ProfilePiece& piece);  // mm
// Area of the surface that the part between two fractions of the length sweeps about the axis,
// mm^2: 2 pi integral of r dl.
[[nodiscard]] double swept_area(const ProfilePiece& piece, double from = 0, double to = 1);
// The piece's share of the volume of the solid, mm^3: pi integral of r^2 dz.
[[nodiscard]] double swept_volume(const ProfilePiece& piece);
// The piece's share of the area that the closed outline encloses in the half plane, mm^2: integral
// of r dz.
[[nodiscard]] double enclosed_area(const ProfilePiece& piece);

// All of an outline's shape in one line, "line r0 z0 r1 z1; arc r0 z0 r1 z1 r z convex; ..." in mm: two outlines with the
// same text are the same, but for what grinds.
[[nodiscard]] std::string outline_text(const std::vector<ProfilePiece>& outline);
// The outline of such a text, bit for bit, all of it grinding. Throws Error unless it is one; its shape isn't checked.
[[nodiscard]] std::vector<ProfilePiece> outline_of(const std::string& text);

// Throws Error naming the piece and the violated condition unless the outline runs from the tip at
// (0, 0) to the axis at the other end, without gaps or self-crossing, solid to the left, within r
// <= 10 mm and 0 <= z <= 50 mm. Returns the outline with joints made exact: ends that differ by
// less than 1e-6 mm are merged, and an arc's centre within 1e-3 mm of the bisector of its ends is
// moved onto it.
[[nodiscard]] std::vector<ProfilePiece> checked_outline(std::vector<ProfilePiece> pieces);

}  // namespace toothprep
