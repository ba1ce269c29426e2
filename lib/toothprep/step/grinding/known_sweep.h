// A straight part of the bur's way, and what the bur took there, as places in a lattice have it. Internal to this folder.
#pragma once

#include "toothprep/step/grinding/straight_sweep.h"
#include "toothprep/step/grinding/swept_outline.h"
#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

struct KnownSweep {
  StraightSweep sweep;
  SweptOutline outline;
  float length = 0;  // of the way, mm
  float margin = 0;  // a voxel, mm
  float l[4], h[4],
      t[4];  // across the way and along it, mm: of places (voxels) from a base, and of the base

  [[nodiscard]] bool is_of(const StraightSweep& other) const noexcept;
  // Whether there is an outline of it.
  bool set(const Bur& bur, const StraightSweep& of) noexcept;
  // Says from where places are counted.
  void put(const Lattice& lattice, const Index3& base) noexcept;

  // At places (voxels, from the base): the value (mm, positive in what it took) as if it had no ends, and where that is so:
  // the bur was nearest on that way, a voxel or more from its ends.
  struct Sample {
    Float4 value;
    Int4 on_way;
    Float4 by_l, by_h;  // gradient
  };
  Sample at(const Float4& x, const Float4& y, const Float4& z) const noexcept {
    const SweptOutline::Sample s = outline.at(across(l, x, y, z), across(h, x, y, z));
    const Float4 way = across(t, x, y, z);
    return {s.value, (way >= s.from + margin) & (way <= s.to + (length - margin)), s.by_l, s.by_h};
  }

 private:
  static Float4 across(const float (&by)[4], const Float4& x, const Float4& y, const Float4& z) {
    return by[0] * x + by[1] * y + by[2] * z + by[3];
  }
};

}  // namespace toothprep
