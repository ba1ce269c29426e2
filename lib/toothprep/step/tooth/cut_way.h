// Where a bur has cut straight on: what it took there is known exactly, where the lattice of a cut rounds it. A tooth that
// was cut keeps it for the next session with that bur.
#pragma once

#include <string>
#include <vector>

#include "toothprep/step/core/geometry.h"
#include "toothprep/step/tooth/brick_grid.h"

namespace toothprep {

// A straight part of a bur's way along which it didn't lean otherwise.
struct StraightPart {
  Pose from;                // of the bur
  Vec3 way = Vec3::Zero();  // W, mm
  double aside = 0;         // mm, by how much the bur was off that line, at most
  bool goes_on = false;     // from where the part before it ended
};

// The straight parts of a bur's way through a tooth's cut, and which of them cut deepest where.
struct CutWay {
  std::string head;                 // of the bur: its outline, as outline_text() has it
  std::vector<StraightPart> parts;  // in the order in which they were cut
  // Of each voxel the part that cut deepest there, counted from 1; 0: none of them, or something else.
  BrickGrid<float> deepest;
};

}  // namespace toothprep
