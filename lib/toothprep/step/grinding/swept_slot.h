// The slot that a flat end leaves, drawn along a straight way. Square to the axis: a floor, walls by the face behind
// the end, and a rounded corner if the bur has one. While a bur with a sharp edge leans along its way: a floor by that
// edge, and walls. In the dimensions of SweptEdge.
#pragma once

#include <cmath>
#include <optional>
#include <vector>

#include "toothprep/step/grinding/swept_edge.h"

namespace toothprep {

class SweptSlot {
 public:
  using Place = SweptEdge::Place;
  // `rounding`: the radius (mm) of an arc that touches the end and the face behind it, which meet in the edge; or 0.
  explicit SweptSlot(const SweptEdge& edge, double rounding = 0)
      : edge_(edge), rounding_(static_cast<float>(rounding)) {}
  // Of a bur with a flat end and a straight face behind it or its rounded corner.
  static std::optional<SweptSlot> of(const std::vector<ProfilePiece>& outline);

  // Says how the bur moves: a unit vector, B. Whether it leaves such a slot.
  bool move(const Vec3& along) noexcept {
    constexpr float kLeastAcross = 0.8f, kSteepest = 0.9f;  // sines
    edge_.move(along);
    const float across = edge_.across(), normal = edge_.normal_after();
    if (across < kLeastAcross || std::abs(normal) > kSteepest * across) return false;
    if (edge_.draws() && rounding_ > 0) return false;
    wall_h_ = normal / across, wall_l_ = std::sqrt(1 - wall_h_ * wall_h_);
    to_wall_ = edge_.radius() * std::sqrt(1 - normal * normal);
    centre_ = (to_wall_ - rounding_ - wall_h_ * rounding_) / wall_l_;
    return true;
  }
  const SweptEdge& edge() const { return edge_; }
  // Whether it has faces alone.
  bool is_plane() const { return !edge_.draws() && !(rounding_ > 0); }

  struct Sample {
    Float4 value;  // mm, of the slot's field: positive in the void
    Place gradient;
    void replace(const Int4& where, const Sample& by) {
      value = where ? by.value : value;
      gradient = {where ? by.gradient.l : gradient.l, where ? by.gradient.h : gradient.h};
    }
  };
  Sample at(const Place& p) const {
    const Float4 wall = turned_where_negative(p.l, all4(wall_l_));
    Sample s{to_wall_ - wall_h_ * p.h - wall * p.l, {-wall, all4(-wall_h_)}};
    if (!edge_.draws()) {  // then the end's face leaves the floor
      s.replace(p.h < s.value, {p.h, {Float4{}, all4(1)}});
      if (!(rounding_ > 0)) return s;
      const Float4 l = magnitude(p.l) - centre_, h = p.h - rounding_,
                   away = square_root(greatest(l * l + h * h, all4(kLeastSquare * kLeastSquare))),
                   towards = -1 / away;
      const Int4 in_corner = (l > 0) & (wall_l_ * h - wall_h_ * l < 0);
      s.replace(in_corner,
                {rounding_ - away, {turned_where_negative(p.l, towards * l), towards * h}});
      return s;
    }
    const SweptEdge::Sample e = edge_.at(p);
    s.replace(e.counts, {-e.distance, {-e.gradient.l, -e.gradient.h}});
    return s;
  }
  // How far aside (mm) that wall lies at this height on which the field has a value.
  Float4 wall_at(const Float4& h, const Float4& value) const {
    return (to_wall_ - value - wall_h_ * h) / wall_l_;
  }
  // A place that has this field. On a wall, far above the edge.
  Place place_of(const Sample& s) const {
    const Float4 square = s.gradient.l * s.gradient.l + s.gradient.h * s.gradient.h,
                 per_slope = -1 / square_root(greatest(square, all4(kLeastSquare)));
    const Place normal = per_slope * s.gradient,
                floor = edge_.draws() ? edge_.contact(-s.value, normal) : floor_of(s.value, normal);
    const Float4 beside = wall_at(all4(kAbove), s.value);
    const Int4 wall = normal.h > wall_h_ - kNoise;
    return {wall ? turned_where_negative(normal.l, beside) : floor.l,
            wall ? all4(kAbove) : floor.h};
  }

 private:
  // On the floor of an end's face, or in a rounded corner.
  Place floor_of(const Float4& value, const Place& normal) const {
    if (!(rounding_ > 0)) return {Float4{}, value};
    const Int4 flat = normal.h < kNoise - 1;
    const Float4 radius = rounding_ - value;
    return {flat ? Float4{} : turned_where_negative(normal.l, all4(centre_)) + radius * normal.l,
            flat ? value : rounding_ + radius * normal.h};
  }

  static constexpr float kAbove = 0.6f;         // mm
  static constexpr float kNoise = 0.02f;        // of normals
  static constexpr float kLeastSquare = 1e-2f;  // keeps a division defined

  SweptEdge edge_;
  float wall_l_ = 1, wall_h_ = 0;  // of the walls' outward normals
  float to_wall_ = 0;              // mm, from the edge's middle
  float rounding_, centre_ = 0;    // mm: of a rounded corner, and how far aside its arc's centre is
};

inline std::optional<SweptSlot> SweptSlot::of(const std::vector<ProfilePiece>& outline) {
  constexpr double kFlat = 1e-3;  // sine
  const auto is_line = [&](std::size_t i) {
    return i < outline.size() && outline[i].kind == ProfilePiece::Kind::kLine;
  };
  if (!is_line(0)) return std::nullopt;
  const ProfilePoint end = point_on(outline[0], 1);
  if (std::abs(end.along_z) > kFlat) return std::nullopt;
  const bool rounded = !is_line(1);
  if (!is_line(rounded ? 2 : 1)) return std::nullopt;
  const ProfilePoint side = point_on(outline[rounded ? 2 : 1], 0);
  if (!(side.along_z > kFlat)) return std::nullopt;
  if (!rounded) return SweptSlot(SweptEdge({end, side}));
  // Both faces touch the corner's arc.
  const ProfilePoint from = point_on(outline[1], 0), to = point_on(outline[1], 1);
  if (!outline[1].convex || std::abs(from.along_z - end.along_z) > kFlat ||
      std::abs(to.along_r - side.along_r) > kFlat)
    return std::nullopt;
  const double corner = side.r - (side.z - end.z) * side.along_r / side.along_z;
  return SweptSlot(SweptEdge({{corner, end.z, end.along_r, end.along_z},
                              {corner, end.z, side.along_r, side.along_z}}),
                   arc_span(outline[1]).radius);
}

}  // namespace toothprep
