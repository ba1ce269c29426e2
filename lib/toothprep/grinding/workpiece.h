// What the step reads and carves: the remaining solid and the tissue labels of a tooth, made ready
// so that nothing is allocated while stepping.
#pragma once

#include "toothprep/tooth/layered_tooth.h"

namespace toothprep {

class Workpiece {
 public:
  // Copies the solid and the labels. Labels are extended two voxels into the air beside the surface
  // (nearest tissue), so that a boundary voxel whose centre lies outside still tells its tissue.
  // Every brick that carving can split gets its place in the pool here.
  explicit Workpiece(const LayeredTooth& tooth);

  const Lattice& lattice() const { return lattice_; }
  double voxel() const { return lattice_.voxel; }
  float band() const { return band_; }
  const LevelSet& solid() const { return solid_; }
  LevelSet& solid() { return solid_; }
  const LabelGrid& labels() const { return labels_; }

 private:
  Lattice lattice_;
  float band_;
  LevelSet solid_;
  LabelGrid labels_;
};

// The trilinear interpolant of a level set at an index position, and its gradient per voxel.
struct FieldSample {
  float value;
  float gx, gy, gz;
};

// Voxel (i, j, k) is the lower corner of the cell, (fx, fy, fz) in [0, 1) the place in it.
// Continuous everywhere; the background outside the box.
inline FieldSample sample_cell(const LevelSet& field, int i, int j, int k, float fx, float fy,
                               float fz) noexcept {
  float c[8];
  const int x = i & 7, y = j & 7, z = k & 7;
  const std::int64_t b = field.brick_index(i, j, k);
  if (b >= 0 && x < 7 && y < 7 && z < 7) {
    if (field.is_uniform(static_cast<std::size_t>(b)))
      return {field.uniform_value(static_cast<std::size_t>(b)), 0, 0, 0};
    const float* v = field.brick(static_cast<std::size_t>(b)) + brick_offset(x, y, z);
    c[0] = v[0], c[1] = v[1], c[2] = v[8], c[3] = v[9];
    c[4] = v[64], c[5] = v[65], c[6] = v[72], c[7] = v[73];
  } else {
    for (int n = 0; n < 8; ++n) c[n] = field.value(i + (n >> 2), j + ((n >> 1) & 1), k + (n & 1));
  }
  const float z00 = c[0] + fz * (c[1] - c[0]), z01 = c[2] + fz * (c[3] - c[2]);
  const float z10 = c[4] + fz * (c[5] - c[4]), z11 = c[6] + fz * (c[7] - c[6]);
  const float y0 = z00 + fy * (z01 - z00), y1 = z10 + fy * (z11 - z10);
  const float d0 = c[1] - c[0] + fy * (c[3] - c[2] - c[1] + c[0]);
  const float d1 = c[5] - c[4] + fy * (c[7] - c[6] - c[5] + c[4]);
  return {y0 + fx * (y1 - y0), y1 - y0, (z01 - z00) + fx * (z11 - z10 - z01 + z00),
          d0 + fx * (d1 - d0)};
}

}  // namespace toothprep
