// The slot that a flat end with a sharp edge leaves, drawn along a straight way while the bur leans along it: a floor by
// the edge, and walls by the face behind that. In the dimensions of SweptEdge.
#pragma once

#include <cmath>

#include "toothprep/step/grinding/swept_edge.h"

namespace toothprep {

class SweptSlot {
 public:
  using Place = SweptEdge::Place;
  explicit SweptSlot(const SweptEdge& edge) : edge_(edge) {}

  // Says how the bur moves: a unit vector, B. Whether it leaves such a slot.
  bool move(const Vec3& along) noexcept {
    constexpr float kLeastAcross = 0.8f, kSteepest = 0.9f;  // sines
    edge_.move(along);
    const float across = edge_.across(), normal = edge_.normal_after();
    if (across < kLeastAcross || std::abs(normal) > kSteepest * across) return false;
    wall_h_ = normal / across, wall_l_ = std::sqrt(1 - wall_h_ * wall_h_);
    to_wall_ = edge_.radius() * std::sqrt(1 - normal * normal);
    return true;
  }
  const SweptEdge& edge() const { return edge_; }

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
                floor = edge_.draws() ? edge_.contact(-s.value, normal) : Place{Float4{}, s.value};
    const Float4 beside = wall_at(all4(kAbove), s.value);
    const Int4 wall = normal.h > wall_h_ - kNoise;
    return {wall ? turned_where_negative(normal.l, beside) : floor.l,
            wall ? all4(kAbove) : floor.h};
  }

 private:
  static constexpr float kAbove = 0.6f;         // mm
  static constexpr float kNoise = 0.02f;        // of normals
  static constexpr float kLeastSquare = 1e-2f;  // keeps a division defined

  SweptEdge edge_;
  float wall_l_ = 1, wall_h_ = 0;  // of the walls' outward normals
  float to_wall_ = 0;              // mm, from the edge's middle
};

}  // namespace toothprep
