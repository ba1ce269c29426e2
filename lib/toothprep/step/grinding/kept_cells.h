// The cells of a cut that were read last, so that a point that creeps through its cell doesn't read it
// anew at each step. They stand as long as the number of the cut does: what is found in them is
// bit for bit what reading them again would find. Internal to contact*.cpp.
#pragma once

#include <algorithm>
#include <cstdint>

#include "toothprep/step/grinding/four_lanes.h"
#include "toothprep/step/grinding/workpiece.h"

namespace toothprep {

// Values of a field at four points, mm, and its gradients, mm per voxel.
struct FourSamples {
  Float4 value, gx, gy, gz;
  void replace(const Int4& where, const FourSamples& by) noexcept {
    value = where ? by.value : value;
    gx = where ? by.gx : gx;
    gy = where ? by.gy : gy;
    gz = where ? by.gz : gz;
  }
};

// What sample_cell() makes of the corners alone.
struct FourCells {
  Float4 c0, c2, c4, c6, c10, c32, c54, c76, low, high;

  // Of corners by cell: the lower four of each, and the upper four.
  void set(Float4 a, Float4 b, Float4 c, Float4 d, Float4 e, Float4 f, Float4 g,
           Float4 h) noexcept {
    transpose(a, b, c, d);
    transpose(e, f, g, h);
    c0 = a, c2 = c, c4 = e, c6 = g;
    c10 = b - a, c32 = d - c, c54 = f - e, c76 = h - g;
    low = d - c - b + a, high = h - g - f + e;
  }
  // Those of the lanes of `wanted`.
  template <class Grid>
  void read(const Grid& field, Int4 i, Int4 j, Int4 k, Int4 wanted) noexcept {
    alignas(16) float corners[4][8] = {};
    for (int p = 0; p < 4; ++p)
      if (wanted[p]) cell_corners(field, i[p], j[p], k[p], corners[p]);
    set(load4(corners[0]), load4(corners[1]), load4(corners[2]), load4(corners[3]),
        load4(corners[0] + 4), load4(corners[1] + 4), load4(corners[2] + 4), load4(corners[3] + 4));
  }
  // Corner k, as cell_corners() numbers them.
  [[nodiscard]] Float4 corner(int k) const noexcept {
    const Float4 lower[4] = {c0, c2, c4, c6}, rise[4] = {c10, c32, c54, c76};
    return k & 1 ? lower[k >> 1] + rise[k >> 1] : lower[k >> 1];
  }
  // How far the field is from linear in them, mm.
  [[nodiscard]] Float4 bend() const noexcept {
    const Float4 yz = low + high, xz = (c54 - c10) + (c76 - c32),
                 xy = 2 * ((c6 - c4) - (c2 - c0)) + ((c76 - c54) - (c32 - c10));
    return 0.5f * (magnitude(yz) + magnitude(xz) + magnitude(xy));
  }
  // As sample_cell(), four at a time.
  [[nodiscard]] FourSamples at(Float4 fx, Float4 fy, Float4 fz) const noexcept {
    const Float4 z00 = c0 + fz * c10, z01 = c2 + fz * c32;
    const Float4 z10 = c4 + fz * c54, z11 = c6 + fz * c76;
    const Float4 y0 = z00 + fy * (z01 - z00), y1 = z10 + fy * (z11 - z10);
    const Float4 d0 = c10 + fy * low, d1 = c54 + fy * high;
    return {y0 + fx * (y1 - y0), y1 - y0, (z01 - z00) + fx * (z11 - z10 - z01 + z00),
            d0 + fx * (d1 - d0)};
  }
};

// The cell of one point, by its lower corner.
struct KeptCell {
  alignas(16) Int4 place = {};  // x, y, z, 0
  std::uint64_t cuts = ~std::uint64_t{0};
  std::int64_t brick = -1;  // -1: outside of the box, or in air
  float corners[8] = {};    // as of cell_corners()

  void read(const Workpiece& workpiece, Int4 at, std::uint64_t number) noexcept {
    if (number == cuts && !any((place ^ at) != 0)) return;
    place = at, cuts = number;
    brick = workpiece.cut().brick_index(at[0], at[1], at[2]);
    if (brick >= 0 && workpiece.air(static_cast<std::size_t>(brick))) brick = -1;
    if (brick >= 0) cell_corners(workpiece.cut(), at[0], at[1], at[2], corners);
  }
};

// The cells of four points, those of them that are asked for.
struct KeptCells {
  Int4 x = {}, y = {}, z = {};  // lower corners
  Int4 asked = {};              // -1 or 0 each
  Int4 live = {};               // of these: within the box, and not in air
  std::int64_t brick[4] = {};   // of those that live
  std::uint64_t cuts = ~std::uint64_t{0};
  FourCells cells = {};

  void read(const Workpiece& workpiece, Int4 i, Int4 j, Int4 k, Int4 wanted,
            std::uint64_t number) noexcept {
    if (number == cuts && !any(((i ^ x) | (j ^ y) | (k ^ z) | (wanted ^ asked)) != 0)) return;
    x = i, y = j, z = k, asked = live = wanted, cuts = number;
    for (int p = 0; p < 4; ++p) {
      if (live[p] == 0) continue;
      brick[p] = workpiece.cut().brick_index(i[p], j[p], k[p]);
      if (brick[p] < 0 || workpiece.air(static_cast<std::size_t>(brick[p]))) live[p] = 0;
    }
    cells.read(workpiece.cut(), i, j, k, live);
  }
};

// The same of the tooth's own fields, which no cut changes: its surface and the tissues that have level
// sets.
struct KeptTissues {
  static constexpr int kFields = tissue_index(Tissue::kOther);

  Int4 x = {}, y = {}, z = {};                  // lower corners
  Int4 solid_read = {}, tissues_read = {};      // -1: of this cell
  Int4 by_fields = {};                          // -1: the level sets tell how a place is shared
  FourCells solid = {}, tissues[kFields] = {};  // by tissue

  void move_to(Int4 i, Int4 j, Int4 k) noexcept {
    if (!any(((i ^ x) | (j ^ y) | (k ^ z)) != 0)) return;
    x = i, y = j, z = k, solid_read = tissues_read = Int4{};
  }
  void read_solid(const Workpiece& workpiece, Int4 wanted) noexcept {
    if (!any(wanted & ~solid_read)) return;
    solid_read = wanted;
    solid.read(workpiece.solid(), x, y, z, wanted);
  }
  void read_tissues(const Workpiece& workpiece, Int4 wanted) noexcept {
    if (!any(wanted & ~tissues_read)) return;
    tissues_read = wanted;
    for (int k = 0; k < kFields; ++k) tissues[k].read(workpiece.tissues()[k], x, y, z, wanted);
    for (int p = 0; p < 4; ++p)
      by_fields[p] = wanted[p] && of_fields(workpiece.labels(), x[p], y[p], z[p]) ? -1 : 0;
  }

 private:
  // Whether corners of a cell are of tissues, all of them with level sets, and not all of the brick's alike.
  static bool of_fields(const LabelGrid& labels, int i, int j, int k) noexcept {
    const std::int64_t brick = labels.brick_index(i, j, k);
    if (brick >= 0 && labels.is_uniform(static_cast<std::size_t>(brick)) && (i & 7) < 7 &&
        (j & 7) < 7 && (k & 7) < 7)
      return false;
    std::uint8_t largest = 0;
    for (int n = 0; n < 8; ++n)
      largest = std::max(largest, labels.value(i + (n >> 2), j + ((n >> 1) & 1), k + (n & 1)));
    static_assert(kFields + 1 == static_cast<int>(Tissue::kOther));
    return largest != 0 && largest < static_cast<std::uint8_t>(Tissue::kOther);
  }
};

// The same of one point: its cell in the tooth's surface and in the tissues' level sets, side by side.
struct KeptFields {
  Int4 place = {};  // x, y, z, 0
  bool known = false;
  FourCells cells = {};  // the surface, then by tissue

  void read(const Workpiece& workpiece, Int4 at) noexcept {
    if (known && !any((place ^ at) != 0)) return;
    place = at, known = true;
    static_assert(KeptTissues::kFields == 3);
    alignas(16) float corners[4][8];
    cell_corners(workpiece.solid(), at[0], at[1], at[2], corners[0]);
    for (int k = 0; k < KeptTissues::kFields; ++k)
      cell_corners(workpiece.tissues()[k], at[0], at[1], at[2], corners[k + 1]);
    cells.set(load4(corners[0]), load4(corners[1]), load4(corners[2]), load4(corners[3]),
              load4(corners[0] + 4), load4(corners[1] + 4), load4(corners[2] + 4),
              load4(corners[3] + 4));
  }
};

}  // namespace toothprep
