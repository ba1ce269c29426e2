// An anatomical lower left first molar as a field given at every point: enamel cap with cusps and
// fissures, dentin, pulp chamber with horns and canals, two roots.
#pragma once

#include <functional>

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// The molar at a point of W (mm). Each distance is f/|grad f| of an implicit function f, so that
// its zero set is exact and its slope there is one; it is good to a few percent within a narrow
// band and has only the right sign far away. Pure and thread-safe.
//
// W stands as a scanner has it (LPS, crown up): the long axis runs along +z through x = 6.1, y
// = 5.5; buccal is +x, mesial is -y; the central fossa lies near z = 16.6 and the cusp tips
// near 18.9. All of the tooth has positive coordinates.
[[nodiscard]] ToothSample sample_molar(const Vec3& x);

// A box that holds the whole tooth, mm.
[[nodiscard]] Box molar_bounds();

struct MolarOptions {  // its size is fixed
  double voxel = 0.1;  // mm
  // Called now and then with the share that is done, from several threads; what it throws ends the
  // work.
  std::function<void(double done)> progress = {};
};

// Voxel centres lie at (i + 1/2) voxel. Throws Error if the voxel size is not in [0.02, 0.5] mm.
[[nodiscard]] LayeredTooth make_molar(const MolarOptions& options);

}  // namespace toothprep
