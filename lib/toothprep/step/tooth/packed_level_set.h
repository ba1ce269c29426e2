// A level set in half the memory of a BrickGrid and less, for fields that are read here and there:
// what remains of each tissue, which the step reads at borders of tissues only.
//
// Of a brick only those rows of four voxels along z are stored that hold a value within the band:
// half of them where a surface passes. A value is two look-ups away, without a branch, and bit for
// bit what was stored. A stored brick never changes, so it can be shared: with copies, with a frozen
// grid (most of enamel's bricks at the surface are the solid's), and with a level set that is the
// negative of this one there (on both sides of a border of two tissues).
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <memory>
#include <vector>

#include "toothprep/step/tooth/brick_grid.h"

namespace toothprep {

// The 512 values of a brick of a packed level set, mm, offset as in brick_offset(). Valid as long as
// the level set stands.
class PackedBrick {
 public:
  float operator[](std::size_t v) const noexcept {  // v: 0..511
    return std::bit_cast<float>(
        std::bit_cast<std::uint32_t>(rows_[kRow * row_of_[v / kRow] + v % kRow]) ^ flip_);
  }
  void unpack(float* values) const noexcept;  // all 512

 private:
  friend class PackedLevelSet;
  static constexpr std::size_t kRow = 4;                     // voxels
  static constexpr std::size_t kRows = kBrickVoxels / kRow;  // of a brick
  PackedBrick(const float* rows, const std::uint8_t* row_of, std::uint32_t flip)
      : rows_(rows), row_of_(row_of), flip_(flip) {}

  const float* rows_;
  const std::uint8_t* row_of_;  // where among rows_ each of the brick's rows is
  std::uint32_t flip_;          // the sign's bit where the values are to be negated, else 0
};

class PackedLevelSet : public BrickBox {  // mm; writing is not safe beside reading
 public:
  PackedLevelSet() = default;
  // `band` (mm) throughout, which is also the value outside the box. Bricks that are `band` or -band
  // throughout take no storage.
  PackedLevelSet(const Index3& first_brick, const Index3& brick_counts, float band);

  std::size_t table_size() const { return places_.size(); }  // bricks in the box
  float background() const { return sides_[0]; }             // the value outside the box, mm

  [[nodiscard]] PackedBrick brick(std::size_t index) const noexcept {  // by table index
    const std::uint32_t place = places_[index];
    if (place <= kInside) return {&sides_[place * PackedBrick::kRow], kFirstRow.data(), 0};
    if (place & kShared)
      return {shared_.bricks.get() + std::size_t{place & ~kShared} * kBrickVoxels, kEachRow.data(),
              0};
    const float* stored = stored_at(place & ~kNegative);
    return {stored + kIndexFloats, reinterpret_cast<const std::uint8_t*>(stored),
            (place & kNegative) << 1};
  }
  float value(int i, int j, int k) const {  // of voxel (i, j, k), which may lie outside the box
    const std::int64_t b = brick_index(i, j, k);
    return b < 0 ? sides_[0]
                 : brick(static_cast<std::size_t>(b))[brick_offset(i & 7, j & 7, k & 7)];
  }
  bool is_uniform(std::size_t index) const { return places_[index] <= kInside; }  // not stored
  float uniform_value(std::size_t index) const { return brick(index)[0]; }        // of such a brick

  // Stores 512 values. What the brick held before keeps its storage: others may share it.
  void set_brick(std::size_t index, const float* values);
  // Makes a brick uniform, without storage if the value is the band's end on one side.
  void set_uniform(std::size_t index, float value);

  // Takes a brick of a frozen grid without copying it, if `values` are those that it holds; not if
  // it is uniform there or has been written since, or if this level set shares another grid's
  // bricks. Says whether it did.
  bool share_brick(std::size_t index, const float* values, const BrickGrid<float>& frozen);
  // Takes the negative of another level set's brick without copying it, if `values` are those; not if
  // it is uniform there, shared itself, or was stored after the first call, which is to come before
  // anything is stored here. Says whether it did.
  bool share_negative(std::size_t index, const float* values, const PackedLevelSet& other);

  // Whether a brick is that of a copy of this level set, or of what this is a copy of: neither was stored since.
  [[nodiscard]] bool same_brick(std::size_t index, const PackedLevelSet& copy) const noexcept;

  [[nodiscard]] BrickGrid<float> unpacked() const;  // bricks in the order of the table

  // Of table and bricks, but for those that are another field's.
  [[nodiscard]] std::size_t memory_bytes() const;
  // The same without the storage that is this level set's as well: a copy of it, or what it was copied from.
  [[nodiscard]] std::size_t memory_bytes_beside(const PackedLevelSet& copy) const;
  // The grid whose bricks it shares; as BrickGrid's.
  const SharedBricks<float>& shared() const { return shared_; }

 private:
  // In the table: which side a uniform brick is on, the place of a shared one in its grid, or that of
  // one in blocks_, in rows.
  static constexpr std::uint32_t kInside = 1;
  static constexpr std::uint32_t kShared = std::uint32_t{1} << 31, kNegative = kShared >> 1;
  static constexpr std::uint32_t kBlockRows = std::uint32_t{1} << 16;
  // A stored brick: its row_of, a row of either side, and those of its own.
  static constexpr int kIndexFloats = PackedBrick::kRows / sizeof(float);
  static constexpr std::array<std::uint8_t, PackedBrick::kRows> kFirstRow = {};
  static constexpr auto kEachRow = [] {  // of a brick that is stored in full
    std::array<std::uint8_t, PackedBrick::kRows> rows{};
    for (std::size_t r = 0; r < rows.size(); ++r) rows[r] = static_cast<std::uint8_t>(r);
    return rows;
  }();

  const float* stored_at(std::uint32_t place) const noexcept {
    return blocks_[place / kBlockRows].get() + std::size_t{place % kBlockRows} * PackedBrick::kRow;
  }

  std::vector<std::uint32_t> places_;
  std::array<float, std::size_t{2} * PackedBrick::kRow> sides_{};  // outside, inside
  std::vector<std::shared_ptr<float[]>> blocks_;
  std::uint32_t used_rows_ = kBlockRows;  // of the last block
  std::size_t own_rows_ = 0;              // stored, here or in what it was copied from
  SharedBricks<float> shared_;
};

// The 512 values of a brick: where they are stored, or unpacked into `scratch`.
template <class T>
[[nodiscard]] const T* brick_values(const BrickGrid<T>& grid, std::size_t index,
                                    std::array<T, kBrickVoxels>& /*scratch*/) {
  return grid.brick(index);
}
[[nodiscard]] inline const float* brick_values(const PackedLevelSet& grid, std::size_t index,
                                               std::array<float, kBrickVoxels>& scratch) {
  grid.brick(index).unpack(scratch.data());
  return scratch.data();
}

}  // namespace toothprep
