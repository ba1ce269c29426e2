// A straight part of the bur's way, and what the bur took there, as places in a lattice have it. Internal to this folder.
#pragma once

#include "toothprep/step/grinding/convex_profile.h"
#include "toothprep/step/grinding/straight_sweep.h"
#include "toothprep/step/grinding/swept_outline.h"
#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

class KnownSweep {
 public:
  // Whether it is known: along the bur's axis it isn't. `standing`: of a bur that stands; kept.
  bool set(const Bur& bur, const ConvexProfile& standing, const StraightSweep& sweep,
           float voxel) noexcept;
  [[nodiscard]] bool is_of(const StraightSweep& sweep) const noexcept;
  const StraightSweep& sweep() const { return sweep_; }
  [[nodiscard]] bool is_known() const { return known_; }
  // Whether an outline was drawn for it, which takes time.
  [[nodiscard]] bool is_drawn() const { return leans_ == Leans::kFar; }
  // Says from where places are counted.
  void put(const Lattice& lattice, const Index3& base) noexcept;

  // At places (voxels, from the base): how far these lie within what the bur took, mm, negative outside; gradient per voxel.
  struct Sample {
    Float4 value;
    Float4 gx, gy, gz;
  };
  static Sample chosen(const Int4& which, const Sample& one, const Sample& other) {
    return {which ? one.value : other.value, which ? one.gx : other.gx, which ? one.gy : other.gy,
            which ? one.gz : other.gz};
  }
  static Sample deeper(const Sample& one, const Sample& other) {
    return chosen(other.value > one.value, other, one);
  }
  // By how much (mm) places lie before where it is deepest there, or behind it: there its beginning or its end tells.
  struct Beyond {
    Float4 start, end;
  };
  Sample at(const Float4& x, const Float4& y, const Float4& z,
            Beyond* beyond = nullptr) const noexcept;
  // Whether its beginning, or its end, may be deepest even beside the way.
  [[nodiscard]] bool may_start() const {
    return leans_ == Leans::kHardly && !(lean_ < 0) && !standing_->has_sharp_end();
  }
  [[nodiscard]] bool may_end() const {
    return leans_ == Leans::kHardly && lean_ < 0 && !standing_->has_sharp_end();
  }

 private:
  static Float4 across(const float (&by)[4], const Float4& x, const Float4& y, const Float4& z) {
    return by[0] * x + by[1] * y + by[2] * z + by[3];
  }
  // Places across the way and along it, and along the axis, mm.
  struct Across {
    Float4 l, h, way, axial;
  };
  Sample where_it_stood(const Float4& end, const Across& at) const noexcept;
  // The same on the way.
  Sample on_way(const Float4& way, const Across& at) const noexcept;
  Sample where_it_dips(const Across& at, Beyond* beyond) const noexcept;
  Float4 edge_passes(const Across& at, const Float4& radius, const Float4& height) const noexcept;

  StraightSweep sweep_;
  bool known_ = false;
  const ConvexProfile* standing_ = nullptr;
  SweptOutline outline_;  // unless the way is square to the axis
  SweptOutline::Axes axes_;
  // The way against square to the axis: not at all; so little that where the bur is beside a place, or where its end passes
  // there, tells; or so that its outline is drawn.
  enum class Leans { kNot, kHardly, kFar } leans_ = Leans::kNot;
  float length_ = 0;             // of the way, mm
  float lean_ = 0, square_ = 1;  // how much of it goes along the axis, and square to it
  // Across the way and along it, and along the bur's axis, mm: of places (voxels) from a base, and of the base.
  float l_[4], h_[4], t_[4], z_[4];
};

}  // namespace toothprep
