// A level set between its voxels.
#pragma once

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// The trilinear interpolant of a level set at a point of W (mm); outside the box the background.
double level_at(const LevelSet& level_set, const Lattice& lattice, const Vec3& x);
double level_at(const PackedLevelSet& level_set, const Lattice& lattice, const Vec3& x);

}  // namespace toothprep
