// Volumes: what was removed, what should have been, and how the two agree.
//
// All solids lie on the original's lattice (on_lattice). Each voxel holds the fraction
//     f = clamp(1/2 - phi/D, 0, 1)
// of material (D voxel size, phi the level set: step/tooth/layered_tooth.h), for the original (o), the
// prepared (p) and the target (t) tooth, and per tissue likewise. Regions of two or three solids
// are sums over voxels of D³ times
//     removed   max(0, f_o - f_p)                 over    max(0, min(f_o, f_t) - f_p)
//     required  max(0, f_o - f_t)                 under   max(0, min(f_o, f_p) - f_t)
//     added     max(0, f_p - f_o)                 inside  removed - over
// so that removed = inside + over and required = inside + under in every voxel, and where two
// surfaces coincide the difference is zero. (A level set of the difference, max(a, -b), would be
// near zero there and count half of every such voxel.)
//     Dice = 2 inside / (removed + required)      (Dice, Ecology 1945;26:297-302)
// "Over-prepared" is what was removed and still stands in the target; "under-prepared" what the
// target has removed and still stands.
//
// Tissues. In a voxel that the original tooth filled and the cut crosses, the remaining fraction of a
// tissue is the volume below two planes, the original's tissue border and the cut (4³ subcubes),
// scaled so that the tissues sum to f_p. The minimum of the two fractions would overestimate layers
// thinner than a voxel between border and cut.
//
// Accuracy. Unbiased for planes at any height and angle; along an edge of two walls the smaller
// fraction is taken instead of the product, D²/12 per mm of edge (on the mean over positions) too
// much or too little. The README has the measured figures.
//
// Noise. When a solid was resampled or registered, coinciding surfaces differ by some micrometres,
// and the max(0, ..) of noise is not zero. With `noise` mm > 0 a difference counts only in voxels
// that have one larger than noise/D among themselves and their 26 neighbours: the cut, not the
// rest of the surface.
#pragma once

#include "toothprep/tools/compare/solid.h"

namespace toothprep {

struct TissueVolumes {         // of one region
  double total = 0;            // mm³
  PerTissue<double> tissue{};  // mm³; sums to the total but for voxels without a label near them
};

struct VolumeComparison {            // original against prepared, and target
  TissueVolumes original, prepared;  // what is there
  TissueVolumes removed;             // tissue `other` (a neighbour, say): damage to it
  double added_mm3 = 0;              // prepared, but not in the original
  bool pulp_exposed = false;         // more than half a voxel of pulp was removed

  // With a target only.
  bool has_target = false;
  TissueVolumes required, inside, over, under;  // of the target: DEFINITIONS.md
  double dice = 0;                              // NaN if nothing was removed and nothing required
  PerTissue<double> tissue_dice{};              // the same per tissue
};

// `prepared` and `target` are on the original's lattice. Throws InputError, naming the file, for
//  - a prepared tooth or a target that lies elsewhere or whose material stands out of the original
//    by more than a voxel: another tooth, or another frame,
//  - a tooth of another anatomy (more than 20 % of the labels differ),
//  - a prepared tooth or a target from which less than eight voxels are missing.
[[nodiscard]] VolumeComparison compare_volumes(const Solid& original, const Solid& prepared,
                                               const Solid* target = nullptr, double noise = 0);

// Half width of the 95 % interval of a region's volume, mm³, from the voxel size alone:
//     0.01 D A + D² L/12 + D³/2,
// with the area A = 6 V^(2/3) and the edges L = 12 V^(1/3) of a cube of that volume. The first term
// is an allowance for planes at odd angles and for curvature, several times what turned boxes gave;
// the second is the edges' (above), the third the least detectable volume. Not in it: an error of
// the scan or of the registration.
[[nodiscard]] double volume_uncertainty_mm3(double volume_mm3, double voxel);

}  // namespace toothprep
