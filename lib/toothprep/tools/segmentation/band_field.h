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

  bool empty() const { return place_.empty(); }
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

// Values of a box's voxels, of which those far from a surface don't matter: one value stands for all of
// them. Kept in chunks as those above.
class TrimmedField {
 public:
  TrimmedField() = default;
  // Of one value per voxel; `far` in the chunks for which there is no one.
  TrimmedField(const Mask& chunks, const std::vector<float>& values, float far)
      : place_(chunks.size()) {
    std::uint32_t count = kFar + 1;
    for (std::size_t c = 0; c < chunks.size(); ++c) place_[c] = chunks[c] ? count++ : kFar;
    values_.assign(count * kChunk, far);
    tbb::parallel_for(std::size_t{0}, chunks.size(), [&](std::size_t c) {
      if (chunks[c])
        std::copy_n(values.data() + c * kChunk, std::min(kChunk, values.size() - c * kChunk),
                    values_.data() + place_[c] * kChunk);
    });
  }

  float operator[](std::size_t v) const { return *at(v); }
  // Ones where it is `least` or more, of the voxels first .. end - 1.
  void not_below(float least, std::size_t first, std::size_t end, std::uint8_t* out) const {
    while (first < end) {
      const std::size_t next = std::min(end, (first / kChunk + 1) * kChunk);
      const float* values = at(first);
      for (std::size_t n = 0, count = next - first; n < count; ++n) out[n] = values[n] >= least;
      out += next - first;
      first = next;
    }
  }
  // The value of voxel v and, behind it, of those that follow in its chunk.
  const float* at(std::size_t v) const {
    return values_.data() + std::size_t{place_[v / kChunk]} * kChunk + v % kChunk;
  }

 private:
  static constexpr std::size_t kChunk = BandField::kChunk;
  static constexpr std::uint32_t kFar = 0;
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
