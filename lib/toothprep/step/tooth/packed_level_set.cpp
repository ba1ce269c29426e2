#include "toothprep/step/tooth/packed_level_set.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <new>

namespace toothprep {

void PackedBrick::unpack(float* values) const noexcept {
  for (std::size_t r = 0; r < kRows; ++r) {
    std::array<std::uint32_t, kRow> row;
    std::memcpy(row.data(), rows_ + kRow * row_of_[r], sizeof row);
    for (std::uint32_t& bits : row) bits ^= flip_;
    std::memcpy(values + kRow * r, row.data(), sizeof row);
  }
}

PackedLevelSet::PackedLevelSet(const Index3& first_brick, const Index3& brick_counts, float band)
    : BrickBox(first_brick, brick_counts) {
  places_.assign(brick_counts.cast<std::size_t>().prod(), 0);
  std::fill_n(sides_.begin(), PackedBrick::kRow, band);
  std::fill_n(sides_.begin() + PackedBrick::kRow, PackedBrick::kRow, -band);
}

void PackedLevelSet::set_brick(std::size_t index, const float* values) {
  constexpr std::size_t kRow = PackedBrick::kRow, kRows = PackedBrick::kRows;
  constexpr std::size_t kRowBytes = kRow * sizeof(float);
  std::array<std::uint8_t, kRows> row_of;
  std::array<float, kBrickVoxels> rows;
  std::size_t stored = 0;
  std::array<bool, 2> has{};  // a row of that side
  for (std::size_t r = 0; r < kRows; ++r) {
    const float* row = values + kRow * r;
    const std::size_t side = row[0] < 0 ? 1 : 0;
    if (std::memcmp(row, &sides_[side * kRow], kRowBytes) == 0) {
      row_of[r] = static_cast<std::uint8_t>(side);
      has[side] = true;
      continue;
    }
    std::memcpy(&rows[stored * kRow], row, kRowBytes);
    row_of[r] = static_cast<std::uint8_t>(2 + stored++);
  }
  if (stored == 0 && !(has[0] && has[1])) {
    places_[index] = has[1] ? kInside : 0;
    return;
  }
  const auto needed = static_cast<std::uint32_t>(kIndexFloats / kRow + 2 + stored);
  // Copies may go on in the same block.
  if (used_rows_ + needed > kBlockRows || blocks_.back().use_count() > 1) {
    if (blocks_.size() >= kNegative / kBlockRows) throw std::bad_alloc();
    blocks_.emplace_back(new float[std::size_t{kBlockRows} * kRow]);
    used_rows_ = 2;  // 0 and 1 are uniform bricks' places
  }
  float* to = blocks_.back().get() + std::size_t{used_rows_} * kRow;
  std::memcpy(to, row_of.data(), kRows);
  std::copy(sides_.begin(), sides_.end(), to + kIndexFloats);
  std::copy_n(rows.begin(), stored * kRow, to + kIndexFloats + sides_.size());
  places_[index] = static_cast<std::uint32_t>(blocks_.size() - 1) * kBlockRows + used_rows_;
  used_rows_ += needed;
  own_rows_ += needed;
}

void PackedLevelSet::set_uniform(std::size_t index, float value) {
  if (std::abs(value) == background()) {
    places_[index] = value < 0 ? kInside : 0;
    return;
  }
  std::array<float, kBrickVoxels> values;
  values.fill(value);
  set_brick(index, values.data());
}

bool PackedLevelSet::share_brick(std::size_t index, const float* values,
                                 const BrickGrid<float>& frozen) {
  if (!frozen.is_shared(index)) return false;
  if (shared_.bricks && shared_.bricks != frozen.shared().bricks) return false;
  const float* brick = frozen.brick(index);
  if (std::memcmp(brick, values, sizeof(float) * kBrickVoxels) != 0) return false;
  shared_ = frozen.shared();
  places_[index] =
      kShared | static_cast<std::uint32_t>((brick - shared_.bricks.get()) / kBrickVoxels);
  return true;
}

bool PackedLevelSet::share_negative(std::size_t index, const float* values,
                                    const PackedLevelSet& other) {
  if (blocks_.empty()) blocks_ = other.blocks_;
  const std::uint32_t place = other.places_[index];
  if (place <= kInside || (place & (kShared | kNegative)) != 0) return false;
  const std::size_t block = place / kBlockRows;
  if (block >= blocks_.size() || blocks_[block] != other.blocks_[block]) return false;
  PackedBrick negative = other.brick(index);
  negative.flip_ = kShared;
  std::array<float, kBrickVoxels> its;
  negative.unpack(its.data());
  if (std::memcmp(its.data(), values, sizeof its) != 0) return false;
  places_[index] = place | kNegative;
  return true;
}

bool PackedLevelSet::same_brick(std::size_t index, const PackedLevelSet& copy) const noexcept {
  const std::uint32_t place = places_[index];
  if (place != copy.places_[index]) return false;
  if (place <= kInside) return true;
  if (place & kShared) return shared_.bricks == copy.shared_.bricks;
  const std::size_t block = (place & ~kNegative) / kBlockRows;
  return block < copy.blocks_.size() && blocks_[block] == copy.blocks_[block];
}

BrickGrid<float> PackedLevelSet::unpacked() const {
  BrickGrid<float> grid(first_brick(), brick_counts(), background(), {-background()});
  grid.reserve(table_size() - static_cast<std::size_t>(std::count_if(
                                  places_.begin(), places_.end(),
                                  [](std::uint32_t place) { return place <= kInside; })));
  std::array<float, kBrickVoxels> values;
  for (std::size_t b = 0; b < table_size(); ++b) {
    if (places_[b] == 0) continue;
    brick(b).unpack(values.data());
    grid.set_brick(b, values.data());
  }
  return grid;
}

std::size_t PackedLevelSet::memory_bytes() const {
  return places_.size() * sizeof(std::uint32_t) + own_rows_ * PackedBrick::kRow * sizeof(float);
}

std::size_t PackedLevelSet::memory_bytes_beside(const PackedLevelSet& copy) const {
  std::size_t rows = 0;
  for (const auto& block : blocks_)
    if (std::find(copy.blocks_.begin(), copy.blocks_.end(), block) == copy.blocks_.end())
      rows += &block == &blocks_.back() ? used_rows_ : kBlockRows;
  return places_.size() * sizeof(std::uint32_t) + rows * PackedBrick::kRow * sizeof(float);
}

}  // namespace toothprep
