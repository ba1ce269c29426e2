// Values of some voxels of a box: those near a surface. Kept in chunks of 16 voxels along x; a chunk
// that isn't kept takes four bytes.
#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstdint>
#include <vector>

#include "toothprep/tools/segmentation/mask_parts.h"

namespace toothprep {

class BandField {
 public:
  static constexpr std::size_t kChunk = 16;

  BandField() = default;
  // Zero in the chunks for which there is a one.
  explicit BandField(const Mask& chunks) : place_(chunks.size(), kNone) {
    std::uint32_t count = 0;
    for (std::size_t c = 0; c < chunks.size(); ++c)
      if (chunks[c]) place_[c] = count++;
    values_.assign(count * kChunk, 0.0f);
  }

  bool has(std::size_t v) const { return place_[v / kChunk] != kNone; }
  float operator[](std::size_t v) const { return values_[at(v)]; }  // if it has
  float& operator[](std::size_t v) { return values_[at(v)]; }       // likewise
  // work(v) for every voxel of first .. end - 1 that it has.
  template <class Work>
  void for_each(std::size_t first, std::size_t end, const Work& work) const {
    while (first < end) {
      const std::size_t next = std::min(end, (first / kChunk + 1) * kChunk);
      if (has(first))
        for (std::size_t v = first; v < next; ++v) work(v);
      first = next;
    }
  }

 private:
  static constexpr std::uint32_t kNone = 0xFFFFFFFF;
  std::size_t at(std::size_t v) const {
    return std::size_t{place_[v / kChunk]} * kChunk + v % kChunk;
  }
  std::vector<std::uint32_t> place_;
  std::vector<float> values_;
};

// A one for each chunk that holds a voxel which is wanted.
template <class Wanted>
Mask chunks_where(std::size_t voxels, const Wanted& wanted) {
  Mask chunks((voxels + BandField::kChunk - 1) / BandField::kChunk);
  tbb::parallel_for(std::size_t{0}, chunks.size(), [&](std::size_t c) {
    const std::size_t end = std::min(voxels, (c + 1) * BandField::kChunk);
    for (std::size_t v = c * BandField::kChunk; v < end && !chunks[c]; ++v) chunks[c] = wanted(v);
  });
  return chunks;
}

}  // namespace toothprep
