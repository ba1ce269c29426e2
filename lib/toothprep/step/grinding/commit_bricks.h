// Has the system give a grid its memory before a session begins. Internal to this folder.
#pragma once

#include <algorithm>
#include <cstddef>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// Takes bricks and gives them back, so that the system commits their memory here and not in a step, which would pay for a
// page as much as for carving ten bricks. As many as a cut takes up that is as large as a crown's, and no more than `most`.
// `grid`: nothing but its background, with one other constant.
inline void commit_bricks(LevelSet& grid, double voxel, std::size_t most) {
  constexpr double kCommitted = 160;             // mm² of a cut's surface
  const double brick_edge = kBrickEdge * voxel;  // mm
  const std::size_t count =
      std::min(most, static_cast<std::size_t>(kCommitted / (brick_edge * brick_edge)));
  for (std::size_t b = 0; b < count; ++b) grid.writable_brick(b);
  for (std::size_t b = 0; b < count; ++b) {
    grid.put_constant(b, 0);
    grid.set_uniform(b, grid.background());
  }
}

}  // namespace toothprep
