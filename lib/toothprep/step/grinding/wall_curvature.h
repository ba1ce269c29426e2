// Curvature of the walls that a bur leaves. A wall's normal tells which part of the bur left it, and that part how
// the wall is curved across the motion: so far from the tip as the bur's profile has no edge and is nowhere concave. The
// wall is taken to be left by the same bur with the same lean, moving the same way.
#pragma once

#include <cmath>
#include <vector>

#include "toothprep/step/bur/profile.h"
#include "toothprep/step/grinding/four_lanes.h"

namespace toothprep {

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

  // Curvature (1/mm) of their field where it has a value (mm). `along_axis`: the motion's direction's part there. An
  // arc goes about in a circle; of that a wall shows the ellipse that it is across the motion.
  Float4 curvature(const Float4& normal, const Float4& value, const Float4& along_axis) const {
    Float4 found{};
    const Float4 square = greatest(1 - normal * normal, all4(kLeastSquare)),
                 ellipse = along_axis * along_axis / (square * square_root(square));
    for (const Arc& arc : arcs_) {
      const Float4 radius = arc.radius + arc.centre * ellipse - value;
      const Int4 here = (normal >= arc.from - kNoise) & (normal < arc.to);
      found = here ? 1 / greatest(radius, all4(kLeastRadius)) : found;
    }
    return found;
  }

 private:
  static constexpr float kNoise = 0.02f;        // of normals
  static constexpr float kLeastSquare = 1e-4f;  // keep divisions defined
  static constexpr float kLeastRadius = 0.01f;  // mm

  struct Arc {
    float from, to;        // normals, their part along the axis
    float centre, radius;  // mm, from the axis; of the arc
  };
  std::vector<Arc> arcs_;
  float up_to_ = -1;
};

}  // namespace toothprep
