// Rigid registration of a prepared (or target) tooth onto the original, surface to surface.
//
// Only the part that was not cut has a counterpart: of a class I cavity nearly all, of a crown
// preparation little more than the root. So the fit must not be pulled by the rest.
//
// 1. Coarse. Principal axes of the area's second moments about its centroid give, with the order
//    and the signs of the axes, 24 rotations; 24 more turn about the most distinct axis by 30
//    degrees each, both ends up (for teeth whose other two axes are alike); and there are no motion
//    and no rotation. Each is improved by a few steps of 2 with few points.
// 2. Iterative closest points (Besl and McKay, IEEE PAMI 1992;14:239-256), point to plane (Chen
//    and Medioni 1992): points x_i of the moving surface, evenly spread over its area, their
//    nearest points y_i on the fixed surface with the normal n_i there; the small motion that
//    minimises sum w_i (n_i·(x_i - y_i))². Tukey's biweight w = (1 - (d/c)²)² for d = |x - y| < c,
//    else 0, and 0 where the two normals differ by more than 60 degrees; c is 6.9 medians of the
//    d below c (4.7 standard deviations), at least 0.02 mm, and never grows. So cut walls fall out.
//    The first steps look at 4000 samples of the fixed surface, the later ones at its triangles.
// 3. The best hypotheses are refined, the best of them by share of agreeing surface is taken; of
//    those that agree equally the one that moves least, with a note.
//
// Agreement is the share of the moving surface's area within 0.2 mm of the fixed one. Teeth match
// if it is half or more, or a quarter or more and sharp: 70 % of that lies within 0.05 mm, which
// the nearest points of different teeth never do.
//
// The same bits for any number of threads.
#pragma once

#include <string>
#include <vector>

#include "toothprep/tools/compare/solid.h"

namespace toothprep {

struct RegistrationOptions {           // the defaults suit teeth
  int points = 8000;                   // of the moving surface, in the last refinement
  int most_iterations = 50;            // of each refinement
  double agree_mm = 0.2;               // what counts as agreeing
  double sharp_mm = 0.05;              // residual that counts as sharp
  double least_share = 0.5;            // of the area that has to agree
  double least_share_if_sharp = 0.25;  // the same where the residual is sharp
};

struct SurfaceRegistration {       // where the moving tooth belongs
  Pose motion;                     // takes the moving tooth's frame to the fixed one's
  double angle_deg = 0;            // how far it turns
  double shift_mm = 0;             // how far it moves the moving surface's centroid
  double residual_rms_mm = 0;      // point to plane, over the inliers
  double residual_p95_mm = 0;      // 95 % of the inliers' |distance|
  double inlier_share = 0;         // of the area: weight above zero in the last step
  double agreeing_share = 0;       // of the area within agree_mm
  int iterations = 0;              // of the last refinement
  bool converged = false;          // its last step was below 1e-5 mm and 1e-6 rad
  std::vector<std::string> notes;  // what a reader must know
};

// Throws InputError (of the moving file) if the teeth don't match, Error for an empty surface.
SurfaceRegistration register_surfaces(const Solid& moving, const Solid& fixed,
                                      const RegistrationOptions& options = {});

}  // namespace toothprep
