// A sparse voxel grid for the 1 kHz step: 8³ bricks in one pool behind a flat table over the box.
//
// The layout inside a brick is that of an OpenVDB leaf (offset = x << 6 | y << 3 | z) and bricks
// are aligned to multiples of 8 voxels, so that a brick becomes a LeafNode by one copy. Uniform
// bricks are not stored: they are entries that point to a shared constant brick. Reads therefore
// never branch on "is this a tile". Writing into a uniform brick takes a brick from the pool;
// reserve() before a session, and the step never allocates. The pool's memory is committed by the
// system when it is first touched, so a generous reserve costs address space only.
//
// A grid that is frozen shares its bricks with its copies, and with grids that are equal to it in
// places (most of an intact solid's bricks are those of what a cut left). Who writes into such a
// brick gets one of its own first.
//
// Why not OpenVDB in the step: tests/step/tooth/bench_brick_grid.cpp measures both for the trilinear
// look-up of the step; the figures stand in this folder's README.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>
#include <type_traits>
#include <vector>

#include "toothprep/step/core/geometry.h"

namespace toothprep {

constexpr int kBrickEdge = 8;                                       // voxels
constexpr int kBrickVoxels = kBrickEdge * kBrickEdge * kBrickEdge;  // 512

[[nodiscard]] constexpr int brick_offset(int x, int y, int z) {  // each 0..7
  return (x << 6) | (y << 3) | z;
}

// The bricks that a grid covers, in units of 8 voxels: [first, first + counts).
class BrickBox {
 public:
  BrickBox() = default;
  // `counts` bricks per axis, the first of them number `first`.
  BrickBox(const Index3& first, const Index3& counts) : first_(first), counts_(counts) {}

  const Index3& first_brick() const { return first_; }    // lower corner of the box, in bricks
  const Index3& brick_counts() const { return counts_; }  // the box's size, in bricks

  // Table index of the brick that holds voxel (i, j, k), or -1 outside the box.
  [[nodiscard]] std::int64_t brick_index(int i, int j, int k) const {
    const int x = (i >> 3) - first_.x(), y = (j >> 3) - first_.y(), z = (k >> 3) - first_.z();
    if (x < 0 || y < 0 || z < 0 || x >= counts_.x() || y >= counts_.y() || z >= counts_.z())
      return -1;
    return (static_cast<std::int64_t>(x) * counts_.y() + y) * counts_.z() + z;
  }
  // First voxel of the brick at a table index.
  [[nodiscard]] Index3 brick_origin(std::size_t index) const {
    const auto z = static_cast<int>(index % counts_.z());
    const auto y = static_cast<int>(index / counts_.z() % counts_.y());
    const auto x = static_cast<int>(index / counts_.z() / counts_.y());
    return (first_ + Index3(x, y, z)) * kBrickEdge;
  }

 private:
  Index3 first_ = Index3::Zero(), counts_ = Index3::Zero();
};

// Bricks that several grids refer to and none writes.
template <class T>
struct SharedBricks {
  std::shared_ptr<const T> bricks;  // one after the other; the same of all that share them
  std::uint32_t count = 0;          // of them

  // What the bricks take, bytes.
  std::size_t memory_bytes() const { return sizeof(T) * kBrickVoxels * std::size_t{count}; }
};

// Values at integer voxel positions; writing is not safe beside reading.
template <class T>
class BrickGrid : public BrickBox {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  BrickGrid() = default;

  // A grid over bricks [first_brick, first_brick + brick_counts) (in units of 8 voxels), everywhere
  // `background`, which is also the value outside the box. `constants` are further values that
  // whole bricks may take without storage.
  BrickGrid(const Index3& first_brick, const Index3& brick_counts, T background,
            const std::vector<T>& constants = {})
      : BrickBox(first_brick, brick_counts) {
    top_.assign(brick_counts.cast<std::size_t>().prod(), 0);
    constants_ = 1 + static_cast<std::uint32_t>(constants.size());
    grow(constants_);
    used_ = constants_;
    fill_brick(0, background);
    for (std::uint32_t c = 1; c < constants_; ++c) fill_brick(c, constants[c - 1]);
  }
  // Copies the stored bricks but for shared ones; free ones are not reserved anew.
  BrickGrid(const BrickGrid& o)
      : BrickBox(o),
        constants_(o.constants_),
        shared_(o.shared_),
        top_(o.top_),
        spare_(o.spare_),
        common_(o.common_) {
    if (o.capacity_ == 0) return;
    grow(o.used_);
    used_ = o.used_;
    std::memcpy(pool_.get(), o.pool_.get(), sizeof(T) * kBrickVoxels * used_);
  }
  BrickGrid& operator=(const BrickGrid& o) {  // the same
    if (this != &o) *this = BrickGrid(o);
    return *this;
  }
  BrickGrid(BrickGrid&&) noexcept = default;             // the storage goes along
  BrickGrid& operator=(BrickGrid&&) noexcept = default;  // the same

  std::size_t table_size() const { return top_.size(); }  // bricks in the box
  T background() const { return pool_[0]; }               // the value outside the box

  T value(int i, int j, int k) const {  // of voxel (i, j, k), which may lie outside the box
    const std::int64_t b = brick_index(i, j, k);
    return b < 0 ? pool_[0] : brick(b)[brick_offset(i & 7, j & 7, k & 7)];
  }

  [[nodiscard]] const T* brick(
      std::size_t index) const {  // 512 values, offset as in brick_offset()
    const std::uint32_t place = top_[index];
    return (place & kShared ? common_.bricks.get() : pool_.get()) +
           static_cast<std::size_t>(place & ~kShared) * kBrickVoxels;
  }
  bool is_uniform(std::size_t index) const { return top_[index] < constants_; }  // not stored
  T uniform_value(std::size_t index) const { return *brick(index); }             // of such a brick

  // The brick for writing; a uniform or shared one is given storage of its own first. Never
  // allocates while bricks_free() > 0; returns null when the pool is exhausted and `may_grow` is
  // false.
  T* writable_brick(std::size_t index, bool may_grow = true) {
    if (is_uniform(index) || is_shared(index)) {
      if (bricks_free() == 0) {
        if (!may_grow) return nullptr;
        grow(capacity_ + capacity_ / 2 + 64);
      }
      T* slot = take_brick();
      std::memcpy(slot, brick(index), sizeof(T) * kBrickVoxels);
      put_brick(index, slot);
    }
    return pool_.get() + static_cast<std::size_t>(top_[index]) * kBrickVoxels;
  }
  // Bricks apart from the table: one is taken, filled, and put in place of what stands there, so
  // that readers see a whole change at once. Never allocates while bricks_free() > 0 or bricks were
  // put back; null when there is none. `put` gives the brick's former storage back for the next
  // taker.
  T* take_brick() {
    if (!spare_.empty()) {
      const std::uint32_t slot = spare_.back();
      spare_.pop_back();
      return pool_.get() + static_cast<std::size_t>(slot) * kBrickVoxels;
    }
    if (used_ == capacity_) return nullptr;
    return pool_.get() + static_cast<std::size_t>(used_++) * kBrickVoxels;
  }
  void put_brick(std::size_t index, const T* taken) {
    leave(index);
    top_[index] = static_cast<std::uint32_t>((taken - pool_.get()) / kBrickVoxels);
  }
  // As set_uniform() with constant number c of the constructor's list, giving the storage back.
  void put_constant(std::size_t index, std::uint32_t c) {
    leave(index);
    top_[index] = c + 1;
  }

  // Makes the brick uniform when `value` is one of the constants; its storage is not reused.
  void set_uniform(std::size_t index, T value) {
    for (std::uint32_t c = 0; c < constants_; ++c)
      if (pool_[static_cast<std::size_t>(c) * kBrickVoxels] == value) {
        shared_ -= is_shared(index);
        top_[index] = c;
        return;
      }
    T* voxels = writable_brick(index);
    for (int v = 0; v < kBrickVoxels; ++v) voxels[v] = value;
  }
  // Stores 512 values, without storage if they all equal one of the constants.
  void set_brick(std::size_t index, const T* values) {
    bool uniform = true;
    for (int v = 1; v < kBrickVoxels && uniform; ++v) uniform = values[v] == values[0];
    if (uniform) return set_uniform(index, values[0]);
    std::memcpy(writable_brick(index), values, sizeof(T) * kBrickVoxels);
  }

  // Shares the stored bricks with all copies that are made of this grid from now on. A grid that
  // shares bricks already stays as it is.
  void freeze() {
    if (common_.bricks || used_ == constants_ || !spare_.empty()) return;
    BrickGrid constants_only;
    constants_only.grow(constants_);
    std::memcpy(constants_only.pool_.get(), pool_.get(), sizeof(T) * kBrickVoxels * constants_);
    grow(used_);  // no free ones
    common_.count = used_;
    common_.bricks = std::shared_ptr<const T>(pool_.release(), Free());
    pool_ = std::move(constants_only.pool_);
    shared_ = 0;
    for (std::uint32_t& place : top_)
      if (place >= constants_) place |= kShared, ++shared_;
    used_ = capacity_ = constants_;
  }
  // Takes the brick that a frozen grid has at this index without copying it; not if it is uniform
  // there or has been written since, or if this grid shares another's bricks. Says whether it did.
  bool share_brick(std::size_t index, const BrickGrid& frozen) {
    if (!frozen.is_shared(index)) return false;
    if (common_.bricks && common_.bricks != frozen.common_.bricks) return false;
    if (!common_.bricks) common_ = frozen.common_;
    leave(index);
    ++shared_;
    top_[index] = frozen.top_[index];
    return true;
  }
  bool is_shared(std::size_t index) const { return (top_[index] & kShared) != 0; }  // not its own

  std::size_t bricks_stored() const {  // in use, shared ones as well
    return used_ - constants_ - spare_.size() + shared_;
  }
  std::size_t bricks_free() const { return capacity_ - used_ + spare_.size(); }  // to be taken
  void reserve(std::size_t free_bricks) {  // throws std::bad_alloc
    if (bricks_free() < free_bricks) grow(used_ + free_bricks);
    spare_.reserve(capacity_);
  }
  [[nodiscard]] std::size_t memory_bytes() const {  // of table and own bricks
    return top_.size() * sizeof(std::uint32_t) + sizeof(T) * kBrickVoxels * std::size_t{used_};
  }
  // All bricks that are shared with this grid; none if it shares no storage.
  const SharedBricks<T>& shared() const { return common_; }

 private:
  struct Free {
    void operator()(T* p) const { std::free(p); }
  };
  void grow(std::size_t capacity) {
    void* grown = std::realloc(pool_.get(), sizeof(T) * kBrickVoxels * capacity);
    if (!grown) throw std::bad_alloc();
    static_cast<void>(pool_.release());
    pool_.reset(static_cast<T*>(grown));
    capacity_ = static_cast<std::uint32_t>(capacity);
  }
  void leave(std::size_t index) {  // what stands in the table, before something else does
    if (is_shared(index))
      --shared_;
    else if (!is_uniform(index))
      spare_.push_back(top_[index]);
  }
  void fill_brick(std::uint32_t b, T value) {
    for (int v = 0; v < kBrickVoxels; ++v)
      pool_[static_cast<std::size_t>(b) * kBrickVoxels + v] = value;
  }

  static constexpr std::uint32_t kShared = std::uint32_t{1} << 31;  // of places in the table

  std::uint32_t constants_ = 0, used_ = 0, capacity_ = 0, shared_ = 0;  // shared_: in the table
  std::vector<std::uint32_t> top_, spare_;  // spare_: slots given back, with room for all of them
  std::unique_ptr<T[], Free> pool_;
  SharedBricks<T> common_;
};

}  // namespace toothprep
