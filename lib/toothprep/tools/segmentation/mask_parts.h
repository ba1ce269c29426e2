// The pieces of a mask, kept as runs of voxels along x: a run takes 12 bytes, and a tooth has some
// hundred thousand of them where its box has tens of millions of voxels.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "toothprep/step/core/geometry.h"

namespace toothprep {

using Mask = std::vector<std::uint8_t>;  // 0 or 1, x fastest

// The voxel at a place of such an array.
inline Index3 index_of(const Index3& size, std::size_t v) {
  const auto nx = static_cast<std::size_t>(size.x()), ny = static_cast<std::size_t>(size.y());
  return {static_cast<int>(v % nx), static_cast<int>(v / nx % ny), static_cast<int>(v / nx / ny)};
}

struct MaskParts {
  // Voxels first .. end - 1 of a row along x.
  struct Run {
    std::uint32_t first, end;
    std::uint32_t part;  // 0, 1, ... from the largest down; of equal ones the first met comes first
  };
  std::size_t row = 0;                 // voxels along x
  std::vector<Run> runs;               // row after row
  std::vector<std::uint32_t> row_end;  // the number of runs up to the end of a row
  std::vector<std::size_t> voxels;     // of each part
  std::vector<std::uint8_t> at_edge;   // each part: touches the array's outermost voxels

  std::size_t count() const { return voxels.size(); }

  // work(first, end, part) for every run, in order; first and end are places in the array.
  template <class Work>
  void for_each(const Work& work) const {
    for (std::size_t j = 0; j < row_end.size(); ++j) for_each_in_row(j, work);
  }
  // Of the j-th row alone.
  template <class Work>
  void for_each_in_row(std::size_t j, const Work& work) const {
    for (std::size_t r = j == 0 ? 0 : row_end[j - 1]; r < row_end[j]; ++r)
      work(j * row + runs[r].first, j * row + runs[r].end, std::size_t{runs[r].part});
  }
};

// Parts whose voxels share faces, of the mask or of what it leaves.
MaskParts parts_of(const Index3& size, const Mask& mask, bool of_rest = false);
// The same of a mask that is made row by row along x: `row` gives the values of the n-th, and is called
// for one after another.
MaskParts parts_of(const Index3& size, const std::function<const std::uint8_t*(std::size_t)>& row,
                   bool of_rest = false);

// Keeps the largest part of the mask; an empty mask stays empty.
void keep_largest_component(const Index3& size, Mask& mask);

// Sets every voxel that is not connected (by faces, outside the mask) with the array's edge: to `value`.
void fill_enclosed(const Index3& size, Mask& mask, std::uint8_t value = 1);

}  // namespace toothprep
