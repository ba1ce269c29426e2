// Exact distances to a mask in its neighbourhood, in two bytes a voxel.
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "toothprep/tools/segmentation/mask_parts.h"

namespace toothprep {

// From each voxel's centre to that of the nearest voxel in the mask, in voxels.
class NearDistance {
 public:
  static constexpr int kMostReach = 180;  // voxels: its square, twice, in 16 bits

  NearDistance() = default;
  // Exact up to `reach`; what is farther away is at infinity. A larger reach than kMostReach is
  // taken as that.
  NearDistance(const Index3& size, const Mask& mask, int reach);

  bool empty() const { return squared_.empty(); }
  float operator[](std::size_t v) const {
    return squared_[v] > most_ ? std::numeric_limits<float>::infinity()
                               : std::sqrt(static_cast<float>(squared_[v]));
  }

 private:
  friend class SurfaceDepth;

  std::vector<std::uint16_t> squared_;
  std::uint16_t most_ = 0;  // what is larger is farther away than the reach
};

// The voxels of the mask that have one outside of it beside them, across a face, an edge or a
// corner.
Mask outermost_of(const Index3& size, const Mask& mask);

// Depth below the mask's surface as far as `reach` - 1/2, else infinity with its sign: positive inside,
// negative outside, the surface half a voxel outside of the outermost voxels' centres. Kept in chunks of
// 16 voxels along x, of which those beyond the reach take four bytes.
class SurfaceDepth {
 public:
  SurfaceDepth(const Index3& size, const Mask& mask, int reach);

  float operator[](std::size_t v) const { return depth_[code(v)]; }
  // Whether it is more than `least`, which is not above zero: a function of the voxel.
  auto above(float least) const {
    // The codes of the inside come first, then those of the outside with the nearest first.
    std::size_t end = depth_.size() / 2;
    while (end < depth_.size() && depth_[end] > least) ++end;
    return [this, end](std::size_t v) { return code(v) < end; };
  }
  // From here on chunks of which all is at least that deep inside or outside are at infinity.
  void keep(float outside, float inside);

 private:
  static constexpr std::size_t kChunk = 16;
  std::uint16_t code(std::size_t v) const {
    return code_[std::size_t{chunk_[v / kChunk]} * kChunk + v % kChunk];
  }
  static constexpr std::uint32_t kFarOutside = 0, kFarInside = 1, kNear = 2;
  std::vector<std::uint32_t> chunk_;  // place of its codes, from kNear on; or where it is
  std::vector<std::uint16_t> code_;
  std::vector<float> depth_;  // of each code
};

}  // namespace toothprep
