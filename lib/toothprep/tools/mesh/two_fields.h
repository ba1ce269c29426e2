// The two fields of a prepared tooth and the cells of its lattice, as sharp_surface.h takes them: f
// the tooth before it was cut, g the negative cut, both mm, index 0 and 1. What remains is where
// both are negative.
//
// Corners of a cell are bit masks as in step/tooth/cell_cases.h; its faces are numbered 2 axis +
// side.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <optional>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// No sample is nearer to zero than this part of a voxel, so that no vertex coincides with a voxel's
// centre; nor are the fields nearer to one another (a cut that follows the tooth's own surface
// leaves that surface) or to one another's opposite (a wall that is thinner is no wall). It moves
// the surfaces by no more than that and twice that.
constexpr float kLeastVoxels = 0.005F;

inline Index3 corner_offset(int corner) {
  return Index3(corner & 1, corner >> 1 & 1, corner >> 2 & 1);
}

using CellValues = std::array<std::array<float, 2>, 8>;  // both fields at a cell's corners

// How a cell's surface is found. Where only one field has a zero in it, and the other is negative,
// the surface is that field's alone.
enum class CellKind { kEmpty, kIntact, kCut, kMargin };

inline CellKind kind_of(const CellValues& corner) {
  std::array<int, 2> negatives{};
  for (const auto& values : corner)
    for (int field = 0; field < 2; ++field) negatives[field] += values[field] < 0;
  if (negatives[0] == 0 || negatives[1] == 0 || negatives[0] + negatives[1] == 16)
    return CellKind::kEmpty;
  return negatives[1] == 8   ? CellKind::kIntact
         : negatives[0] == 8 ? CellKind::kCut
                             : CellKind::kMargin;
}

inline unsigned negative_corners(const CellValues& corner, int field) {
  unsigned negative = 0;
  for (int c = 0; c < 8; ++c) negative |= static_cast<unsigned>(corner[c][field] < 0) << c;
  return negative;
}

// A face's corners, counter-clockwise seen from outside. The first and the third are the ends of
// the diagonal that divides it in tetrahedra.
inline std::array<int, 4> corners_of_face(int axis, int side) {
  const int u = 1 << (axis + 1) % 3, v = 1 << (axis + 2) % 3, base = side << axis;
  return side == 0 ? std::array{base, base | v, base | u | v, base | u}
                   : std::array{base, base | u, base | u | v, base | v};
}

class Fields {
 public:
  explicit Fields(const LayeredTooth& tooth)
      : intact_(tooth.parts->intact),
        cut_(tooth.parts->cut),
        least_(kLeastVoxels * static_cast<float>(tooth.lattice.voxel)) {}
  std::array<float, 2> at(const Index3& i) const {
    return both(intact_.value(i.x(), i.y(), i.z()), cut_.value(i.x(), i.y(), i.z()));
  }
  CellKind kind(const Index3& cell) const {
    CellValues corner;
    for (int c = 0; c < 8; ++c) corner[c] = at(cell + corner_offset(c));
    return kind_of(corner);
  }
  // Of the brick that holds a voxel: value(offset in the brick) gives both fields there.
  auto brick_at(const Index3& voxel) const {
    const float *intact = values(intact_, voxel), *cut = values(cut_, voxel);
    return [this, intact, cut](int offset) {
      return both(intact ? intact[offset] : intact_.background(),
                  cut ? cut[offset] : cut_.background());
    };
  }
  // Of one field, in a cell's middle.
  float middle(const Index3& cell, int field) const {
    float sum = 0;
    for (int c = 0; c < 8; ++c) sum += at(cell + corner_offset(c))[field];
    return kept_away(sum / 8);
  }
  // Bricks along each axis, with one more layer at the lower sides, whose cells reach into the box.
  Index3 brick_counts() const { return intact_.brick_counts() + Index3::Ones(); }
  Index3 first_voxel() const { return (intact_.first_brick() - Index3::Ones()) * kBrickEdge; }
  std::size_t bricks() const { return brick_counts().cast<std::size_t>().prod(); }
  Index3 brick_origin(std::size_t brick) const {  // its first voxel
    const Index3 counts = brick_counts();
    return first_voxel() + kBrickEdge * Index3(static_cast<int>(brick / counts.z() / counts.y()),
                                               static_cast<int>(brick / counts.z() % counts.y()),
                                               static_cast<int>(brick % counts.z()));
  }
  std::optional<std::size_t> brick_of(const Index3& voxel) const {
    const Index3 counts = brick_counts(), in = voxel - first_voxel();
    if (in.minCoeff() < 0) return std::nullopt;
    const Index3 b = in / kBrickEdge;
    if ((counts - b).minCoeff() <= 0) return std::nullopt;
    return (static_cast<std::size_t>(b.x()) * counts.y() + b.y()) * counts.z() + b.z();
  }
  // Whether the surface can pass through a cell that starts in the brick: not if a field is known
  // to be positive in it and its upper neighbours, or both to be negative.
  bool may_pass(const Index3& first) const {
    bool f_out = true, g_out = true, inside = true;
    for (int n = 0; n < 8; ++n) {
      const Index3 i = first + kBrickEdge * corner_offset(n);
      const std::optional<float> f = uniform(intact_, i), g = uniform(cut_, i);
      f_out = f_out && f && *f > 0;
      g_out = g_out && g && *g < 0;
      inside = inside && f && *f < 0 && g && *g > 0;
    }
    return !f_out && !g_out && !inside;
  }

 private:
  float kept_away(float v) const {
    return std::abs(v) < least_ ? std::copysign(least_, v < 0 ? -1.0F : 1.0F) : v;
  }
  std::array<float, 2> both(float intact, float cut) const {
    const float f = kept_away(intact), g = -cut;
    return {f, kept_away(std::abs(g - f) < least_   ? f - least_
                         : std::abs(g + f) < least_ ? least_ - f
                                                    : g)};
  }
  // Of the brick that holds a voxel, or null outside the box.
  static const float* values(const LevelSet& grid, const Index3& i) {
    const std::int64_t b = grid.brick_index(i.x(), i.y(), i.z());
    return b < 0 ? nullptr : grid.brick(static_cast<std::size_t>(b));
  }
  static std::optional<float> uniform(const LevelSet& grid, const Index3& i) {
    const std::int64_t b = grid.brick_index(i.x(), i.y(), i.z());
    if (b < 0) return grid.background();
    if (!grid.is_uniform(static_cast<std::size_t>(b))) return std::nullopt;
    return grid.uniform_value(static_cast<std::size_t>(b));
  }
  const LevelSet &intact_, &cut_;
  float least_;
};

// Both fields at the voxels of a brick and of the first layer of its upper neighbours.
class BrickSamples {
 public:
  BrickSamples(const Fields& fields, const Index3& first) : fields_(fields), first_(first) {
    for (int n = 0; n < 8; ++n) {
      const Index3 upper = corner_offset(n), low = kBrickEdge * upper,
                   high = kBrickEdge * Index3::Ones() + upper;
      const auto both = fields.brick_at(first + low);
      for (int x = low.x(); x < high.x(); ++x)
        for (int y = low.y(); y < high.y(); ++y)
          for (int z = low.z(); z < high.z(); ++z)
            samples_[offset(x, y, z)] = both(brick_offset(x & 7, y & 7, z & 7));
    }
    find_kinds();
  }
  CellValues cell(const Index3& at) const {
    const bool inside = within(at);
    CellValues corner;
    for (int c = 0; c < 8; ++c) {
      const Index3 i = at + corner_offset(c);
      corner[c] = inside ? samples_[offset(i.x(), i.y(), i.z())] : fields_.at(first_ + i);
    }
    return corner;
  }
  // Of a cell of the brick, by its offset.
  CellKind kind(int cell) const { return kinds_[cell]; }
  // The faces of a cell, as bits, behind which a cell is divided into tetrahedra.
  unsigned divided_faces(const Index3& at) const {
    unsigned faces = 0;
    for (int axis = 0; axis < 3; ++axis)
      for (int side = 0; side < 2; ++side) {
        const Index3 beside = at + (2 * side - 1) * Index3::Unit(axis);
        if ((within(beside) ? kinds_[brick_offset(beside.x(), beside.y(), beside.z())]
                            : kind_of(cell(beside))) == CellKind::kMargin)
          faces |= 1U << (2 * axis + side);
      }
    return faces;
  }

 private:
  static constexpr int kSide = kBrickEdge + 1;
  static int offset(int x, int y, int z) { return (x * kSide + y) * kSide + z; }
  static bool within(const Index3& at) { return at.minCoeff() >= 0 && at.maxCoeff() < kBrickEdge; }
  // As kind_of(), by the signs alone, a row of samples at a time.
  void find_kinds() {
    std::array<std::array<unsigned, 2>, kSide * kSide> negative{};  // bit z, of each field
    for (int row = 0; row < kSide * kSide; ++row)
      for (int z = 0; z < kSide; ++z)
        for (int field = 0; field < 2; ++field)
          negative[row][field] |= static_cast<unsigned>(samples_[row * kSide + z][field] < 0) << z;
    for (int x = 0; x < kBrickEdge; ++x)
      for (int y = 0; y < kBrickEdge; ++y) {
        std::array<unsigned, 2> some{}, all{};
        for (int field = 0; field < 2; ++field) {
          const unsigned a = negative[x * kSide + y][field], b = negative[x * kSide + y + 1][field],
                         c = negative[(x + 1) * kSide + y][field],
                         d = negative[(x + 1) * kSide + y + 1][field];
          const unsigned any_of_four = a | b | c | d, all_four = a & b & c & d;
          some[field] = any_of_four | any_of_four >> 1;
          all[field] = all_four & all_four >> 1;
        }
        const unsigned empty = ~(some[0] & some[1]) | (all[0] & all[1]);
        for (int z = 0; z < kBrickEdge; ++z)
          kinds_[brick_offset(x, y, z)] = (empty >> z & 1) != 0    ? CellKind::kEmpty
                                          : (all[1] >> z & 1) != 0 ? CellKind::kIntact
                                          : (all[0] >> z & 1) != 0 ? CellKind::kCut
                                                                   : CellKind::kMargin;
      }
  }

  const Fields& fields_;
  Index3 first_;
  std::array<std::array<float, 2>, kSide * kSide * kSide> samples_;
  std::array<CellKind, kBrickVoxels> kinds_;
};

}  // namespace toothprep
