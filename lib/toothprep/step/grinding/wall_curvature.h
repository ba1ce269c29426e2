// Curvature of the walls that a bur leaves. A wall's normal tells which part of the bur left it, and that part how
// the wall is curved across the motion: so far from the tip as the bur's profile has no edge and is nowhere concave. The
// wall is taken to be left by the same bur with the same lean, moving the same way.
#pragma once

#include <cmath>
#include <vector>

#include "toothprep/step/bur/profile.h"
#include "toothprep/step/grinding/four_lanes.h"

namespace toothprep {

// What an arc of the bur's profile leaves that is swept straight along a unit vector u. Its circle, seen along u, is an
// ellipse, and the arc goes about each point of that in a circle: so in the direction of a unit normal n across the
// motion, with n_a the part of n along the bur's axis, the wall reaches out to radius + centre sqrt(1 - n_a²), but for a
// shift. A place in the void is as deep as it is from the nearest of the tangents of these normals.
//
// Swept square to the axis that ellipse is a line, and what the end between the arcs leaves is plane; where on it a place
// lies its normal doesn't tell.
struct SweptArc {
  Float4 centre, radius;  // mm, from the axis; of the arc

  // Where a place is known: the field's value (mm, positive in the void), and the parts along the axis of its normal
  // (outwards of the bur), of the unit vector square to that and to u, and of u.
  struct Known {
    Float4 value, normal, aside, motion;
  };
  // Curvature (1/mm) of the field there.
  Float4 curvature(const Known& k) const {
    const Float4 of_arc =
        1 / greatest(radius - k.value + stretched(square_at(k.normal), k), all4(kLeastRadius));
    return is_plane(k) ? Float4{} : of_arc;
  }

  // The field beside it; its normal is turned by the angle of this cosine and sine towards `aside`.
  struct Tangent {
    Float4 value, cosine, sine;
    // Where an ellipse is nearly a line Newton's method leads astray unless it begins near the end: at the normal of the
    // ellipse under the place, or beside it of the circle about its end. `wide`: half of its width; the place is from its
    // middle.
    void begin_flat(const Int4& where, const Known& k, const Float4& wide, const Float4& out,
                    const Float4& beside) {
      const Float4 lean = magnitude(k.motion), per = 1 / square_root(1 - lean * lean),
                   h = per * k.normal, l = square_root(greatest(1 - h * h, Float4{})),
                   aside_h = per * k.aside, aside_l = -turned_where_negative(k.aside, h);
      const Float4 at_l = l * out + aside_l * beside, at_h = h * out + aside_h * beside,
                   low = greatest(-at_h, all4(kLeastRadius)),
                   under = within(wide * at_l / (wide + lean * low), wide),
                   off_end = square_root((1 + kBlunt * kBlunt) * wide * wide - under * under),
                   past_end = greatest(magnitude(at_l) - wide, Float4{}) / low,
                   slant = turned_where_negative(
                       at_l, greatest(magnitude(lean * under / off_end), past_end)),
                   length = 1 / square_root(1 + slant * slant);
      cosine = where ? length * (slant * l - h) : cosine;
      sine = where ? length * (slant * aside_l - aside_h) : sine;
    }
  };
  // `out`: mm along the normal, `beside`: along `aside`.
  Tangent at(const Known& k, const Float4& out, const Float4& beside) const {
    const Float4 square = square_at(k.normal), reach = square_root(square), from = radius - k.value,
                 // From the ellipse's middle.
        far_out = from + centre * reach + out,
                 far_beside = beside - centre * k.normal * k.aside / reach;
    // First as if the wall were a circle, then by Newton's method.
    Tangent t{};
    const Float4 down = greatest(from + out + stretched(square, k), all4(kLeastRadius)),
                 per = 1 / square_root(down * down + beside * beside);
    t.cosine = per * down, t.sine = per * beside;
    const Int4 is_square = (centre > 0) & (k.motion * k.motion < kSquare);
    if (const Int4 flat = (centre > 0) & (k.motion * k.motion < kFlat) & ~is_square; any(flat))
      t.begin_flat(flat, k, greatest(centre, all4(kLeastRadius)), far_out, far_beside);
    const bool is_circle = !any(centre != 0);
    Float4 there = reach;
    for (int i = 0; i < (is_circle || all(is_square) ? 0 : kSteps); ++i) {
      const Float4 normal = t.cosine * k.normal + t.sine * k.aside,
                   turns = t.cosine * k.aside - t.sine * k.normal, at = square_at(normal);
      const Float4 slope = far_out * t.sine - far_beside * t.cosine -
                           centre * normal * turns / square_root(at),
                   bends = greatest(from + out + stretched(at, k), all4(kLeastRadius)),
                   turn = greatest(least(-slope / bends, all4(kMostTurn)), all4(-kMostTurn)),
                   length = 1 / square_root(1 + turn * turn),
                   cosine = length * (t.cosine - turn * t.sine);
      t.sine = length * (t.sine + turn * t.cosine), t.cosine = cosine;
    }
    if (!is_circle) there = square_root(square_at(t.cosine * k.normal + t.sine * k.aside));
    t.value = k.value + from * t.sine * t.sine / (1 + t.cosine) +
              centre * (there - reach * t.cosine) - out * t.cosine - far_beside * t.sine;
    // Square to the axis the ellipse is a line: beside its end the arc is a circle, over it the wall is plane.
    if (any(is_square)) {
      const Float4 along = from + out,
                   from_end = along * reach - turned_where_negative(k.aside, k.normal * beside);
      const Int4 over = is_square & (from_end < 0), on_circle = is_square & ~over;
      const Float4 away = square_root(along * along + beside * beside),
                   towards = 1 / greatest(away, all4(kLeastRadius));
      t.value = over        ? radius + along * k.normal + beside * k.aside
                : on_circle ? radius - away
                            : t.value;
      t.cosine = over ? -k.normal : on_circle ? towards * along : t.cosine;
      t.sine = over ? -k.aside : on_circle ? towards * beside : t.sine;
    }
    const Int4 plane = is_plane(k);
    t.value = plane ? k.value - out : t.value;
    t.cosine = plane ? all4(1) : t.cosine, t.sine = plane ? Float4{} : t.sine;
    return t;
  }

 private:
  static constexpr int kSteps = 3;
  static constexpr float kMostTurn = 0.5f;  // a step, rad
  static constexpr float kPlane = 0.0025f;  // sine squared, of the normal and of the motion
  static constexpr float kSquare = 1e-4f, kFlat = 0.01f;  // likewise, of the motion
  static constexpr float kBlunt = 0.2f;                   // of an ellipse's end
  static constexpr float kLeastSquare = 1e-4f;            // keep divisions defined
  static constexpr float kLeastRadius = 0.01f;            // mm

  Int4 is_plane(const Known& k) const {
    return (centre > 0) & (1 - k.normal * k.normal < kPlane) & (k.motion * k.motion < kPlane);
  }
  static Float4 square_at(const Float4& normal) {
    return greatest(1 - normal * normal, all4(kLeastSquare));
  }
  // The ellipse's radius of curvature, by the square of what it reaches out by there (of the circle's radius).
  Float4 stretched(const Float4& square, const Known& k) const {
    return centre * k.motion * k.motion / (square * square_root(square));
  }
};

class WallCurvature {
 public:
  // `outline` from the tip on.
  explicit WallCurvature(const std::vector<ProfilePiece>& outline) {
    constexpr double kEdge = 0.05;  // sine
    ProfilePoint last{0, 0, 1, 0};
    for (const ProfilePiece& piece : outline) {
      const bool is_arc = piece.kind == ProfilePiece::Kind::kArc;
      const ProfilePoint from = point_on(piece, 0), to = point_on(piece, 1);
      const double turn = last.along_r * from.along_z - last.along_z * from.along_r;
      if (!piece.grinds || (is_arc && !piece.convex) || std::abs(turn) > kEdge) return;
      const auto f = [](double x) { return static_cast<float>(x); };
      if (is_arc) {
        arcs_.push_back({f(-from.along_r), f(-to.along_r), f(piece.centre_r),
                         f(std::hypot(piece.r0 - piece.centre_r, piece.z0 - piece.centre_z))});
        up_to_ = arcs_.back().to + kNoise;
      } else {
        up_to_ -= 2 * kNoise;  // a side's normals are those of the edge at its end as well
      }
      last = to;
    }
  }

  // Whether walls of these outward normals (of the bur; their part along its axis) were left by that part of it.
  Int4 know(const Float4& normal) const { return normal < up_to_; }

  // The arc that left a wall of this normal.
  SweptArc arc(const Float4& normal) const {
    SweptArc found{};
    for (const Arc& arc : arcs_) {
      const Int4 here = (normal >= arc.from - kNoise) & (normal < arc.to);
      found.centre = here ? all4(arc.centre) : found.centre;
      found.radius = here ? all4(arc.radius) : found.radius;
    }
    return found;
  }

 private:
  static constexpr float kNoise = 0.02f;  // of normals

  struct Arc {
    float from, to;        // normals, their part along the axis
    float centre, radius;  // mm, from the axis; of the arc
  };
  std::vector<Arc> arcs_;
  float up_to_ = -1;
};

}  // namespace toothprep
