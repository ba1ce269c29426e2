// The dark cavity inside a tooth: pulp chamber and canals, found by connectivity.
#pragma once

#include <algorithm>
#include <vector>

#include "toothprep/tools/segmentation/dense_filters.h"
#include "toothprep/tools/segmentation/grey_classes.h"
#include "toothprep/tools/segmentation/near_distance.h"
#include "toothprep/tools/segmentation/work_box.h"

namespace toothprep {

struct Cavity {
  double ball = 0;  // radius of the ball that separated inside from outside, voxels
  // How far (voxels) a voxel of the cavity is from where the ball's centre comes in from the outside;
  // little beyond the ball's radius all is at infinity. Zero elsewhere; empty if there is no cavity.
  BandField from_outside;
  double grey = 0;    // typical value in it
  double border = 0;  // grey of its border: half-way to dentin

  bool empty() const { return from_outside.empty(); }
  bool holds(std::size_t v) const { return !empty() && from_outside.has(v) && from_outside[v] > 0; }
  // work(v) for every voxel of it among first .. end - 1.
  template <class Work>
  void for_each(std::size_t first, std::size_t end, const Work& work) const {
    if (empty()) return;
    from_outside.for_each(first, end, [&](std::size_t v) {
      if (from_outside[v] > 0) work(v);
    });
  }
};

// Everything that is dark and inside. A cavity counts if it is closed, or if a ball too thick for
// its openings fits into it: fissures and furcations are dark and narrow too, but no such ball fits
// in them without coming from the outside. The ball grows (radii of 0.35 to 1 mm) until it finds a
// cavity of a pulp's size. `blur`: width of the scan's borders, voxels; `margin`: voxels between
// the tooth and the box's edge, at least.
Cavity find_cavity(const WorkBox& box, const TrimmedField& grey, const GreyClasses& classes,
                   double blur, double margin);

}  // namespace toothprep
