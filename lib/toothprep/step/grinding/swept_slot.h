// The slot that a flat end leaves, drawn along a straight way. Square to the axis: a floor, walls by the face behind
// the end, and a rounded corner if the bur has one. While the bur leans along its way: a floor by its edge, and walls;
// a rounded corner's floor is everywhere as far from the ellipse that the circle of the arcs' centres draws. In the
// dimensions of SweptEdge.
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
  // `centres`: then the circle of its centres, as an edge between the same faces.
  explicit SweptSlot(const SweptEdge& edge) : square_(edge), leaning_(edge) {}
  SweptSlot(const SweptEdge& edge, const SweptEdge& centres, double rounding)
      : square_(edge), leaning_(centres), rounding_(static_cast<float>(rounding)) {}
  // Of a bur with a flat end and a straight face behind it or its rounded corner.
  static std::optional<SweptSlot> of(const std::vector<ProfilePiece>& outline);

  // Says how the bur moves: a unit vector, B. Whether it leaves such a slot.
  bool move(const Vec3& along) noexcept {
    constexpr float kLeastAcross = 0.8f, kSteepest = 0.9f, kLeastLean = 0.03f;  // sines
    square_.move(along), leaning_.move(along);
    const float across = edge().across(), normal = edge().normal_after();
    if (across < kLeastAcross || std::abs(normal) > kSteepest * across) return false;
    if (edge().draws() && !has_sharp_edge() && edge().lean() < kLeastLean) return false;
    wall_h_ = normal / across, wall_l_ = std::sqrt(1 - wall_h_ * wall_h_);
    to_wall_ = edge().radius() * std::sqrt(1 - normal * normal);
    if (edge().draws()) to_wall_ += rounding_;
    centre_ = (to_wall_ - rounding_ - wall_h_ * rounding_) / wall_l_;
    return true;
  }
  const SweptEdge& edge() const { return square_.draws() ? leaning_ : square_; }
  bool has_sharp_edge() const { return !(rounding_ > 0); }
  // Whether it has faces alone.
  bool is_plane() const { return !edge().draws() && has_sharp_edge(); }

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
    if (!edge().draws()) {  // then the end's face leaves the floor
      s.replace(p.h < s.value, {p.h, {Float4{}, all4(1)}});
      if (has_sharp_edge()) return s;
      const Float4 l = magnitude(p.l) - centre_, h = p.h - rounding_,
                   away = square_root(greatest(l * l + h * h, all4(kLeastSquare * kLeastSquare))),
                   towards = -1 / away;
      const Int4 in_corner = (l > 0) & (wall_l_ * h - wall_h_ * l < 0);
      s.replace(in_corner,
                {rounding_ - away, {turned_where_negative(p.l, towards * l), towards * h}});
      return s;
    }
    if (!has_sharp_edge()) {
      const Place n = normal_towards(p);
      s.replace(wall_l_ * n.h - wall_h_ * magnitude(n.l) < 0,
                {rounding_ - (p.l * n.l + p.h * n.h - edge().reach(n)), {-n.l, -n.h}});
      return s;
    }
    const SweptEdge::Sample e = edge().at(p);
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
    const Place normal = per_slope * s.gradient, floor = floor_of(s.value, normal);
    const Float4 beside = wall_at(all4(kAbove), s.value);
    const Int4 wall = normal.h > wall_h_ - kNoise;
    return {wall ? turned_where_negative(normal.l, beside) : floor.l,
            wall ? all4(kAbove) : floor.h};
  }

 private:
  // On the floor of an end's face or of an edge, or in a rounded corner.
  Place floor_of(const Float4& value, const Place& normal) const {
    if (edge().draws())
      return has_sharp_edge() ? edge().contact(-value, normal)
                              : edge().contact(Float4{}, normal) + (rounding_ - value) * normal;
    if (has_sharp_edge()) return {Float4{}, value};
    const Int4 flat = normal.h < kNoise - 1;
    const Float4 radius = rounding_ - value;
    return {flat ? Float4{} : turned_where_negative(normal.l, all4(centre_)) + radius * normal.l,
            flat ? value : rounding_ + radius * normal.h};
  }

  // The outward normal of the ellipse of centres at which it is nearest to a place outside of it: there the place is
  // farther than the ellipse reaches by the most. Two steps of Newton's method are right to 0.02 um from 0.1 mm on, from
  // the normal of a flat ellipse under the place, or beside it of its end.
  Place normal_towards(const Place& p) const {
    const float radius = edge().radius(), lean = edge().lean();
    const Float4 l = magnitude(p.l), down = greatest(-p.h, all4(kLeastDown)),
                 under = least(radius * l / (radius + lean * down), all4(radius)),
                 off_end = square_root((1 + kBlunt * kBlunt) * radius * radius - under * under),
                 aside = greatest(lean * under / off_end, (l - radius) / down);
    Float4 per = 1 / square_root(1 + aside * aside);
    Place n{per * aside, -per};
    for (int i = 0; i < kSteps; ++i) {
      const Float4 reach = edge().reach(n), slope = n.l * p.h - n.h * l + edge().slope(n),
                   bends = greatest(n.l * l + n.h * p.h - reach + edge().bend(n), all4(kLeastDown)),
                   turn = within(slope / bends, all4(kMostTurn));
      n = {n.l - turn * n.h, n.h + turn * n.l};
      per = 1 / square_root(n.l * n.l + n.h * n.h);
      n = per * n;
    }
    return {turned_where_negative(p.l, n.l), n.h};
  }

  static constexpr int kSteps = 2;
  static constexpr float kBlunt = 0.5f;         // of an ellipse's end
  static constexpr float kMostTurn = 0.5f;      // a step, rad
  static constexpr float kLeastDown = 1e-2f;    // mm
  static constexpr float kAbove = 0.6f;         // mm
  static constexpr float kNoise = 0.02f;        // of normals
  static constexpr float kLeastSquare = 1e-2f;  // keeps a division defined

  SweptEdge square_, leaning_;     // which of them, `edge` says
  float wall_l_ = 1, wall_h_ = 0;  // of the walls' outward normals
  float to_wall_ = 0;              // mm, from the edge's middle
  float rounding_ = 0;             // mm, of a corner's arc
  float centre_ = 0;               // mm, how far aside its centre is, square to the axis
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
  const ProfilePiece& arc = outline[1];
  const auto between_faces = [&](double r, double z) {
    return SweptEdge({{r, z, end.along_r, end.along_z}, {r, z, side.along_r, side.along_z}});
  };
  return SweptSlot(between_faces(corner, end.z), between_faces(arc.centre_r, arc.centre_z),
                   arc_span(arc).radius);
}

}  // namespace toothprep
