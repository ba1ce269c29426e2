// The surface that a segmentation in voxels was taken from, as far as its steps say.
//
// Of all functions that are positive at the centres inside and negative at those outside, the one
// that bends least is taken (V. Lempitsky, "Surface extraction from binary volumes with
// higher-order smoothness", CVPR 2010):
//
//   minimise  sum over voxels and axes a of  w_a (h² d²f/da²)²   with  side·f >= margin
//
// in a band around the steps. A plane costs nothing, whatever its angle, so walls neither shrink nor
// bulge, and every centre stays on its side: along the lattice the surface moves by less than half a
// voxel. The weights w = 1 / (1 + (B/delta)²)², B the change of slope over three voxels, are found
// twice (iteratively reweighted least squares, Holland and Welsch 1977): edges, where the slope
// changes once and for all, bend for nothing and stay sharp; a step changes it back and forth.
// Where one side is one or two voxels thin along an axis nothing is smoothed across it.
//
// The minimum is approached by projected gradients with Nesterov's momentum (FISTA, Beck and
// Teboulle 2009), a fixed number of steps: the same bits for any number of threads.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "toothprep/step/core/geometry.h"

namespace toothprep {

// A voxel's side of the surface: bit 0 inside or not; bit 1: it may lie on the other, too.
using Sides = std::vector<std::uint8_t>;
constexpr std::uint8_t kInside = 1, kFree = 2;

class LabelSurface {
 public:
  // `sides` has `size` voxels of `spacing` (mm), x fastest; its outermost `border(reach)` voxels on
  // all sides are alike. `reach` voxels (1 or 2) beyond those at the steps belong to the band.
  // `fineness`, at most 1: the spacing over that of what is made of it; finer labels have smaller
  // steps, for which fewer steps of the method do. Throws Error if there is not the memory.
  LabelSurface(const Index3& size, Sides sides, const Vec3& spacing, int reach, double fineness);

  static int border(int reach) { return reach + 5; }

  // The places of the voxels in the band: offsets in the array, ascending.
  const std::vector<std::size_t>& band() const { return voxel_; }

  // Positive inside; near the surface about the distance in units of the least spacing. At a
  // fractional voxel, linear between the voxels, which must exist.
  float at(const Vec3& index) const;

 private:
  struct Band;
  void find_band();
  void start(Band& band) const;
  void relax(Band& band) const;
  float value(std::size_t v) const {
    if (place_[v] >= 0) return value_[static_cast<std::size_t>(place_[v])];
    return sides_[v] & kInside ? far_ : -far_;
  }

  Index3 size_;
  Sides sides_;
  Vec3 spacing_;
  int reach_, steps_;
  float far_;                        // beyond the band
  std::vector<std::int32_t> place_;  // of a voxel in the band; -1
  std::vector<std::size_t> voxel_;   // of a place
  std::vector<float> value_;         // of a place
};

}  // namespace toothprep
