// Exact distances to a mask in its neighbourhood, in one or two bytes a voxel.
#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
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
  // The same of a mask that is made row by row along x, from several threads: row(j, k, scratch) gives its
  // values, where they are or as written to `scratch`.
  using MaskRow = std::function<const std::uint8_t*(int j, int k, std::uint8_t* scratch)>;
  NearDistance(const Index3& size, const MaskRow& row, int reach);

  bool empty() const { return !bytes_ && !words_; }
  float operator[](std::size_t v) const {
    const int square = squared(v);
    return square > most_ ? std::numeric_limits<float>::infinity()
                          : std::sqrt(static_cast<float>(square));
  }
  // Whether it is more than `radius`, which is not above the reach: a function of the voxel.
  auto beyond(double radius) const {
    int least = 0;
    while (least <= most_ && !(std::sqrt(static_cast<float>(least)) > radius)) ++least;
    return [bytes = bytes_.get(), words = words_.get(), least](std::size_t v) {
      return (bytes ? bytes[v] : words[v]) >= least;
    };
  }

 private:
  friend class SurfaceDepth;
  int squared(std::size_t v) const { return bytes_ ? bytes_[v] : words_[v]; }

  std::unique_ptr<std::uint8_t[]> bytes_;  // squared, if the largest fits
  std::unique_ptr<std::uint16_t[]> words_;
  int most_ = 0;  // what is larger is farther away than the reach
};

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
  // The same of the voxels first .. end - 1, as ones.
  void above(float least, std::size_t first, std::size_t end, std::uint8_t* out) const;
  // A one for each chunk that holds a voxel of a depth that is wanted.
  template <class Wanted>
  Mask chunks_where(const Wanted& wanted) const {
    Mask chunks(chunk_.size());
    tbb::parallel_for(std::size_t{0}, chunks.size(), [&](std::size_t c) {
      const std::uint16_t* codes = code_.data() + chunk_[c] * kChunk;
      const std::size_t count = chunk_[c] < kNear ? 1 : std::min(kChunk, voxels_ - c * kChunk);
      bool any = false;
      for (std::size_t n = 0; n < count && !any; ++n) any = wanted(depth_[codes[n]]);
      chunks[c] = any;
    });
    return chunks;
  }
  // work(first, end, far) for each chunk, from several threads: `far` where all of it has the same depth,
  // which is infinite.
  template <class Work>
  void for_each_chunk(const Work& work) const {
    tbb::parallel_for(std::size_t{0}, chunk_.size(), [&](std::size_t c) {
      work(c * kChunk, std::min(voxels_, (c + 1) * kChunk), chunk_[c] < kNear);
    });
  }
  // From here on chunks of which all is at least that deep inside or outside are at infinity.
  void keep(float outside, float inside);

 private:
  static constexpr std::size_t kChunk = 16;
  std::uint16_t code(std::size_t v) const {
    return code_[std::size_t{chunk_[v / kChunk]} * kChunk + v % kChunk];
  }
  static constexpr std::uint32_t kFarOutside = 0, kFarInside = 1, kNear = 2;
  std::size_t voxels_;
  std::vector<std::uint32_t> chunk_;  // place of its codes, from kNear on; or where it is
  std::vector<std::uint16_t> code_;
  std::vector<float> depth_;  // of each code
};

}  // namespace toothprep
