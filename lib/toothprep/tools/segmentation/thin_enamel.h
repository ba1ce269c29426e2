// Enamel too thin to reach enamel's grey: as thin as about one voxel of the scan.
//
// Where enamel runs out at the neck, the scan's blur mixes its grey with the dentin's below and the
// surroundings' outside, so that no threshold finds it or says how thick it is. Along the surface's
// normal the grey of a layer of thickness t is known, though (K. Treece, A. Gee, P. Mayhew, K. Poole,
// High resolution cortical bone thickness measurement from clinical CT data, Medical Image Analysis
// 2010):
//
//   g(x) = A + (E - A) Phi((x - s) / sigma) - (E - D) Phi((x - s - t) / sigma)
//
//   symbol | meaning                                  | from
//   A      | grey of the surroundings                 | the profile's outer end
//   E      | enamel's grey                            | the scan's classes
//   D      | dentin's grey                            | the profile's inner end
//   sigma  | blur, standard deviation                 | edge_sigma()
//   s, t   | place of the surface, thickness          | least squares
//
// As in Treece's method the bright layer's grey must be known: with it and t both free a narrow layer
// can't be told from a darker, thicker one. A layer much thinner than sigma looks like a surface that
// lies farther out, so t has an uncertainty that grows towards zero; a layer counts from 0.6 scan
// voxels, if it is 3 standard deviations of noise thick and above what the roots' profiles, which have
// no enamel, give (reconstructions that sharpen edges overshoot there), and if it borders on enamel that
// thresholds find, or on such a layer.
#pragma once

#include "toothprep/tools/segmentation/surface_profiles.h"

namespace toothprep {

struct ThinEnamel {
  struct Voxel {
    std::size_t at = 0;  // offset in the box; increasing
    float above = 0;     // distance above the border to dentin, voxels; negative in the dentin
    float cover = 0;     // 0..1: which threshold the surface has, dentin's .. enamel's
  };
  std::vector<Voxel> voxels;  // near such enamel, on both sides of the surface
  double area = 0;            // of such enamel, voxels^2
};

// `noise`: standard deviation of the scan's greys. `sigma`: voxels.
// Voxels are named from `outside` voxels outside the surface.
ThinEnamel find_thin_enamel(const WorkBox& box, SurfaceProfiles profiles, const SurfaceDepth& depth,
                            const BandField& level, const GreyClasses& classes, double sigma,
                            double noise, double blur, double outside);

}  // namespace toothprep
