// A straight part of the bur's way, and what the bur took there, as places in a lattice have it. Internal to this folder.
#pragma once

#include "toothprep/step/grinding/convex_profile.h"
#include "toothprep/step/grinding/straight_sweep.h"
#include "toothprep/step/grinding/swept_outline.h"
#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

class KnownSweep {
 public:
  // Whether it is known: if the bur is convex. `standing`: of a bur that stands; kept.
  bool set(const ConvexProfile& standing, const StraightSweep& sweep) noexcept;
  [[nodiscard]] bool is_of(const ConvexProfile& standing,
                           const StraightSweep& sweep) const noexcept;
  const StraightSweep& sweep() const { return sweep_; }
  [[nodiscard]] bool is_known() const { return known_; }
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

 private:
  static Float4 across(const float (&by)[4], const Float4& x, const Float4& y, const Float4& z) {
    return by[0] * x + by[1] * y + by[2] * z + by[3];
  }
  // Places from the tip where the way begins, mm: beside the plane of axis and way, square to the axis in that plane, along
  // the axis.
  struct Across {
    Float4 beside, ahead, axial;
  };
  // How deep places lie in the bur that stands somewhere on the way, and how that changes per mm.
  struct Stood {
    Float4 value, by_beside, by_ahead, by_axial;
  };
  Stood where_it_stood(const Float4& way, const Across& at) const noexcept;
  Stood deepest_on_way(const Across& at) const noexcept;
  Sample sample_of(const Stood& of) const noexcept;

  StraightSweep sweep_;
  bool known_ = false;
  const ConvexProfile* standing_ = nullptr;
  SweptOutline outline_;  // unless the way is square to the axis, or along it
  bool leans_ = false, is_along_ = false;
  float length_ = 0;  // of the way, mm
  // How much of it goes along the axis, and square to it; where the bur sinks, `ahead` is counted against the way, so that
  // it rises.
  float axial_ = 0, ahead_ = 1, rise_ = 0;
  Vec3 along_ = Vec3::UnitX();  // B, of `ahead`
  // Of places (voxels) from a base, and of the base, mm.
  float b_[4], a_[4], z_[4];
};

}  // namespace toothprep
