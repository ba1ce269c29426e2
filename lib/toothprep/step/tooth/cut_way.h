// Where burs have cut straight on: what they took there is known exactly, where the lattice of a cut rounds it. A tooth that
// was cut keeps it for the next session.
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
  int head = 0;             // which of the heads it was
};

// The straight parts of burs' ways through a tooth's cut, and which of them cut deepest where.
struct CutWay {
  std::vector<std::string> heads;   // of these burs: their outlines, as outline_text() has them
  std::vector<StraightPart> parts;  // in the order in which they were cut
  // Of each voxel the part that cut deepest there, counted from 1; 0: none of them, or something else.
  BrickGrid<float> deepest;
};

}  // namespace toothprep
