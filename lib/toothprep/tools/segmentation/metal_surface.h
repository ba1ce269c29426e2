// Where metal ends, in a scan that shows it too large.
//
// The border of metal is where the grey is half-way between the metal's and its surroundings', whatever
// surrounds it: one threshold for all lies too far out in air and dentin. Scanners clip greys: then
// the metal's own isn't seen, half-way isn't in the scan, and every border that can be drawn in it lies
// outside. What is seen still says how high the edge goes: with the blur known (edge_sigma()), the
// lower flank of an edge
//
//   g(x) = T + (M - T) Phi((x - s) / sigma)
//
// from the surroundings' grey T is the steeper the higher the metal's grey M is. M is the one that the
// ways between a fifth and three fifths of T .. clip fit best all over the metal's surface (least sum of
// absolute differences), and s follows. Metal thinner than three voxels of the scan doesn't reach its
// grey and comes out too thick. Streaks and shadows aren't corrected.
#pragma once

#include "toothprep/tools/segmentation/surface_profiles.h"

namespace toothprep {

struct MetalSurface {
  struct Voxel {
    std::size_t at = 0;  // offset in the box; increasing
    float inside = 0;    // distance below the metal's surface, voxels; negative outside it
    float outer = 0;     // T: grey of what surrounds the metal here
  };
  Mask metal;  // to a voxel, beyond the surface too where greys are too bright; empty if none
  std::vector<Voxel> voxels;  // on both sides of the surface
  double grey = 0;            // M
};

// `clip`: the highest grey of the scan, if many voxels have it. Metal is sought where `domain` is set.
// `sigma`: voxels.
MetalSurface find_metal_surface(const WorkBox& box, const ImageVolume<float>& scan,
                                const TrimmedField& grey, const Mask& domain,
                                const GreyClasses& classes, std::optional<double> clip,
                                double sigma, double blur);

}  // namespace toothprep
