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

// Its size is fixed; the variants are of the same kind of truth, and can be combined.
struct MolarOptions {
  double voxel = 0.1;     // mm
  bool premolar = false;  // one cusp each to buccal and lingual, one root; 8.4 x 7 mm
  double worn = 0;        // mm off the highest cusp, flat; 0 to 4
  bool rootless = false;  // cut off flat below the neck
  double tilt_deg = 0;    // leans so far towards mesial and buccal alike, about its crown
  // Called now and then with the share that is done, from several threads; what it throws ends the
  // work.
  std::function<void(double done)> progress = {};
};

// As sample_molar() and molar_bounds(), of a variant.
[[nodiscard]] ToothSample sample_variant(const Vec3& x, const MolarOptions& options);
[[nodiscard]] Box molar_bounds(const MolarOptions& options);

// Voxel centres lie at (i + 1/2) voxel. Throws Error if the voxel size is not in [0.02, 0.5] mm, or
// for options out of range.
[[nodiscard]] LayeredTooth make_molar(const MolarOptions& options);

// Its parts: what refuses options, and the source and axes among a tooth's metadata.
void check_molar_options(const MolarOptions& options);
void describe_molar(const MolarOptions& options, LayeredTooth& tooth);

}  // namespace toothprep
