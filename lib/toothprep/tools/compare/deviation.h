// How far the prepared surface lies from the target surface.
//
// d(x) is the signed distance (mm) of a point x of the prepared surface to the nearest point of
// the target's surface, positive outside the target:
//     d > 0   under-prepared: material left standing above the target
//     d < 0   over-prepared: cut too deep
// Region of interest: the cut, i.e. points deeper inside the original than the tolerance
// (cut_surface.h), and points that were not cut where the target is (d > tolerance). The rest of
// the tooth says nothing about the preparation and would only dilute the figures.
//
// Figures are weighted by area: each vertex stands for a third of its triangles. The 95 % figure
// is the smallest |d| that 95 % of the area does not exceed. The Hausdorff distance is the larger
// of the largest |d| in the region and the largest distance, to the prepared surface, of the
// points of the target that lie in its own region (cut by the target, or cut away by the
// preparation); taken at vertices, which lie closer than two voxels to each other.
//
// The nearest point is the nearest of the whole target, the uncut surface too: at the rim of a
// wall that was cut too far by w, |d| falls from w to 0 over the uppermost w mm of the wall,
// because the uncut surface of the target is nearer than its wall.
//
// Accuracy: the distances themselves are exact to 1e-5 mm. Surfaces of teeth that were cut here have sharp
// margins and line angles (sharp_surface.h); those of other teeth are marching-cubes surfaces, whose edges are
// bevelled within a voxel.
#pragma once

#include <array>
#include <vector>

#include "toothprep/tools/compare/solid.h"

namespace toothprep {

struct DeviationOptions {       // mm
  double cut_tolerance_mm = 0;  // 0: cut_tolerance() of the original's lattice
  double bin_mm = 0.02;         // of the histogram
  double most_mm = 2;           // the histogram's ends, at most
};

struct DeviationBin {                           // of the histogram
  double from_mm = 0, to_mm = 0, area_mm2 = 0;  // half-open
};

struct Deviation {                // by area, over the region that either cut touched
  std::vector<float> per_vertex;  // mm, of the prepared surface; NaN outside the region
  double area_mm2 = 0;            // of the region
  double mean_mm = 0, rms_mm = 0, p95_mm = 0;         // p95: of |deviation|
  double least_mm = 0, most_mm = 0;                   // the deepest over- and the largest under-cut
  double to_target_mm = 0, to_prepared_mm = 0;        // the two directed Hausdorff distances
  double hausdorff_mm = 0;                            // the larger
  Vec3 worst = Vec3::Zero();                          // W: where it is
  double share_within_0_1 = 0, share_within_0_2 = 0;  // of the area, mm
  // Equal bins symmetric about 0 that hold all of the region; what lies beyond
  // DeviationOptions::most_mm is in the outermost ones.
  std::vector<DeviationBin> histogram;
};

// All on the original's lattice. Throws InputError if the region is empty.
Deviation measure_deviation(const Solid& original, const Solid& prepared, const Solid& target,
                            const DeviationOptions& options = {});

}  // namespace toothprep
