// The surface in a pyramid over a face of a cell, with its apex in the cell's middle: what joins a
// cell that is one piece to one that is divided into tetrahedra.
//
// As in step/tooth/cell_cases.h, on each side the cuts separate the inside corners, and a loop of
// cuts is filled by a fan none of whose diagonals lies in a side. Over half a face, a triangle, the
// pyramid is a tetrahedron.
#pragma once

#include <array>

namespace toothprep {

constexpr int kCellMiddle = 8;  // beside the cell's corners 0 to 7

struct PyramidLoop {
  int size = 0;
  std::array<std::array<int, 2>, 6> edge{};  // between these corners; the lower one first
  int apex = 0;                              // of the fan
};
struct PyramidLoops {
  int count = 0;
  std::array<PyramidLoop, 2> loop;  // counter-clockwise seen from where the field is positive
};

// base: the `corners` (3 or 4) of the cell's face, counter-clockwise seen from outside the cell.
// negative: the corners that lie inside, as bits; the middle's too.
PyramidLoops pyramid_loops(const std::array<int, 4>& base, int corners, unsigned negative);

}  // namespace toothprep
