// A field of which only the signs count, and the values beside a change of sign: what says where
// surfaces are. Kept in chunks of 16 voxels along x; a chunk without a change of sign takes four bytes.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "toothprep/tools/segmentation/mask_parts.h"

namespace toothprep {

// A part of a row along x: from first to end - 1.
struct RowPart {
  int first = 0, end = 0;
};

class SignedField {
 public:
  using ValueAt = std::function<float(std::size_t v)>;

  SignedField() = default;
  // Positive where the mask (or a volume of labels), x fastest, is `inside`; of what `value` says beside
  // the changes of sign, from several threads: of that sign and never zero.
  SignedField(const Index3& size, const std::vector<std::uint8_t>& labels, std::uint8_t inside,
              const ValueAt& value);
  // Of one value per voxel, nowhere zero.
  SignedField(const Index3& size, const std::vector<float>& values);

  bool empty() const { return chunk_.empty(); }
  // The value beside a change of sign (across a face), elsewhere 0.5 with its sign.
  float operator[](std::size_t v) const {
    return values_[std::size_t{chunk_[v / kChunk]} * kChunk + v % kChunk];
  }
  // Ones where it is positive, of a row from voxel `first` on; gives the part of it beside which there may
  // be a change of sign.
  RowPart signs(std::size_t first, int count, std::uint8_t* positive) const;
  // Values of the voxels first .. first + count - 1.
  void copy(std::size_t first, std::size_t count, float* values) const;

 private:
  static constexpr std::size_t kChunk = 16;
  std::vector<std::uint32_t> chunk_;  // place of the chunk's values; 0 and 1 are -0.5 and 0.5
  std::vector<float> values_;
};

}  // namespace toothprep
