// What the step reads and carves: a tooth and the cut in it, made ready so that nothing is
// allocated while stepping.
//
// The cut is a level set of its own: the union of all places of the bur, negative where nothing was
// cut. What remains is max(tooth, cut). Kept apart, each field is smooth where the step samples it,
// and the sharp edge where a cut meets the tooth's surface isn't rounded by interpolation: sampled
// as one field it cost up to a voxel of contact along every such edge. A tooth that was cut before and
// knows it (ToothParts) is taken apart likewise, so that a further session finds what one long one
// would have found.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <memory>
#include <optional>
#include <type_traits>
#include <vector>

#include "toothprep/step/grinding/changed_bricks.h"
#include "toothprep/step/grinding/workpiece_bodies.h"
#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

class Bur;
class SweepHistory;  // sweep_history.h

class Workpiece {  // one tooth under one session's bur; not for two threads at a time
 public:
  // Keeps a reference to `tooth`, which must outlive it. Every brick that carving can touch gets
  // its place in the pool here.
  explicit Workpiece(const LayeredTooth& tooth);
  explicit Workpiece(LayeredTooth&&) = delete;
  ~Workpiece();

  const LayeredTooth& tooth() const { return tooth_; }  // as given: never carved
  // The solid before anything that cut() knows was cut, mm.
  const LevelSet& solid() const { return *solid_; }
  // Enamel, dentin and pulp before that, mm; what remains of them where the tooth keeps no other.
  const std::array<PackedLevelSet, 3>& tissues() const { return *tissues_; }
  const Lattice& lattice() const { return tooth_.lattice; }  // the tooth's and the cut's
  double voxel() const { return tooth_.lattice.voxel; }      // D, mm
  float band() const { return band_; }                       // half width of the cut's band, mm
  // Number of the cut's constant for a brick of which nothing is left (BrickGrid::put_constant).
  static constexpr std::uint32_t kAllCut = 0;
  // Bricks that can be carved apart before they are put in place, beyond those that tissue takes.
  std::size_t spare_bricks() const { return spare_bricks_; }
  const LevelSet& cut() const { return cut_; }  // mm, negative where nothing was cut
  // Whoever writes into the cut marks the brick in changed().
  LevelSet& cut() { return cut_; }
  struct CutState {          // the cut at some time, to go back to
    LevelSet cut;            // mm, as cut()
    std::int32_t parts = 0;  // how many the burs' ways had
  };
  [[nodiscard]] CutState cut_state() const;  // as it is now
  // The cut as it was, in the storage that was reserved for it. Marks what changes in changed().
  void restore(const CutState& before);
  // Bricks of the cut that changed since they were last taken, for a display.
  const ChangedBricks& changed() const { return changed_; }
  ChangedBricks& changed() { return changed_; }

  // Labels, extended two voxels into the air beside the surface (nearest tissue), so that a
  // boundary voxel whose centre lies outside still has its tissue.
  const LabelGrid& labels() const { return labels_; }

  // Where burs have cut straight on, and now this one does. Allocates when its head is a new one.
  SweepHistory& way_of(const Bur& bur);
  // The cut was changed otherwise than by those ways.
  void forget_way();
  // For apply_cut(): the way so far, if it is known.
  [[nodiscard]] std::optional<CutWay> kept_way() const;

  // Whose each voxel is, and what was removed of each; null if the tooth has one body.
  const WorkpieceBodies* bodies() const { return bodies_ ? &*bodies_ : nullptr; }
  WorkpieceBodies* bodies() { return bodies_ ? &*bodies_ : nullptr; }

  // Of a brick and its seven upper neighbours, i.e. of every cell that starts in the brick, by
  // table index: the one tissue that occurs (0 if several or none do), and whether all lie deeper
  // in the tooth than the band.
  std::uint8_t only_tissue(std::size_t brick) const { return cells_[brick].only_tissue; }
  bool deep(std::size_t brick) const { return cells_[brick].deep; }
  bool air(std::size_t brick) const { return cells_[brick].air; }

  // What remains: max(tooth, cut).
  [[nodiscard]] LevelSet remaining_solid() const;

 private:
  struct CellsOfBrick {
    std::uint8_t only_tissue = 0;
    bool deep = false;
    bool air = false;
  };
  void take_up_cut(const LevelSet& cut);

  const LayeredTooth& tooth_;
  const LevelSet* solid_;
  const std::array<PackedLevelSet, 3>* tissues_;
  float band_;
  LevelSet cut_;
  ChangedBricks changed_;
  std::size_t spare_bricks_;
  LabelGrid labels_;
  std::optional<WorkpieceBodies> bodies_;
  std::vector<CellsOfBrick> cells_;
  std::unique_ptr<SweepHistory> way_;  // the tooth's, or since it was first asked for
};

// Carves the tooth that the workpiece is of, or a copy of it, by the workpiece's cut, as apply_cut() of layered_tooth.h
// does, and keeps the bur's way as well. After the tooth itself the workpiece is of no use any more.
void apply_cut(LayeredTooth& tooth, const Workpiece& workpiece);

// The trilinear interpolant of a level set at an index position, and its gradient per voxel.
struct FieldSample {
  float value;       // mm
  float gx, gy, gz;  // mm per voxel
};

// The eight corners of the cell whose lower corner is voxel (i, j, k), z fastest; the background
// outside.
template <class Grid>  // LevelSet or PackedLevelSet
void cell_corners(const Grid& field, int i, int j, int k, float* c) noexcept {
  const Index3& first = field.first_brick();
  const Index3& counts = field.brick_counts();
  const int bx = (i >> 3) - first.x(), by = (j >> 3) - first.y(), bz = (k >> 3) - first.z();
  const int x = i & 7, y = j & 7, z = k & 7;
  const auto inside = [](int b, int n) {  // b and b + 1 are bricks
    return static_cast<std::uint32_t>(b) < static_cast<std::uint32_t>(std::max(n, 1) - 1);
  };
  if (!inside(bx, counts.x()) || !inside(by, counts.y()) || !inside(bz, counts.z())) {
    for (int n = 0; n < 8; ++n) c[n] = field.value(i + (n >> 2), j + ((n >> 1) & 1), k + (n & 1));
    return;
  }
  const std::size_t stride_y = static_cast<std::size_t>(counts.z()),
                    stride_x = stride_y * static_cast<std::size_t>(counts.y());
  const std::size_t b = static_cast<std::size_t>(bx) * stride_x +
                        static_cast<std::size_t>(by) * stride_y + static_cast<std::size_t>(bz);
  // Two values side by side along z, at once where they are so in memory.
  const auto copy_two = [](const auto& brick, int offset, float* to) {
    if constexpr (std::is_pointer_v<std::remove_cvref_t<decltype(brick)>>)
      std::memcpy(to, brick + offset, 2 * sizeof(float));
    else
      to[0] = brick[offset], to[1] = brick[offset + 1];
  };
  const auto v = field.brick(b);
  const int o = brick_offset(x, y, z);
  if (x < 7 && y < 7 && z < 7) {
    copy_two(v, o, c), copy_two(v, o + 8, c + 2);
    copy_two(v, o + 64, c + 4), copy_two(v, o + 72, c + 6);
    return;
  }
  const std::size_t b_x = x < 7 ? 0 : stride_x, b_y = y < 7 ? 0 : stride_y;
  const int to_x = x < 7 ? 64 : -7 * 64, to_y = y < 7 ? 8 : -7 * 8;
  const auto read_two = [&](std::size_t at, int offset, float* to) {
    if (z < 7) return copy_two(field.brick(at), offset, to);
    to[0] = field.brick(at)[offset];
    to[1] = field.brick(at + 1)[offset - 7];
  };
  read_two(b, o, c);
  read_two(b + b_y, o + to_y, c + 2);
  read_two(b + b_x, o + to_x, c + 4);
  read_two(b + b_x + b_y, o + to_x + to_y, c + 6);
}

// Trilinear value and gradient at (fx, fy, fz) in [0, 1) of a cell with the corner values c0 .. c7,
// z fastest.
[[nodiscard]] inline FieldSample sample_cell(float c0, float c1, float c2, float c3, float c4,
                                             float c5, float c6, float c7, float fx, float fy,
                                             float fz) noexcept {
  const float z00 = c0 + fz * (c1 - c0), z01 = c2 + fz * (c3 - c2);
  const float z10 = c4 + fz * (c5 - c4), z11 = c6 + fz * (c7 - c6);
  const float y0 = z00 + fy * (z01 - z00), y1 = z10 + fy * (z11 - z10);
  const float d0 = c1 - c0 + fy * (c3 - c2 - c1 + c0);
  const float d1 = c5 - c4 + fy * (c7 - c6 - c5 + c4);
  return {y0 + fx * (y1 - y0), y1 - y0, (z01 - z00) + fx * (z11 - z10 - z01 + z00),
          d0 + fx * (d1 - d0)};
}
[[nodiscard]] inline FieldSample sample_cell(const float* c, float fx, float fy,
                                             float fz) noexcept {
  return sample_cell(c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], fx, fy, fz);
}

}  // namespace toothprep
