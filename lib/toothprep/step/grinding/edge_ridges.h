// Ridges that a sharp edge of a bur leaves where it is swept in steps.
//
// Where an edge runs along a wall as the last to touch it, each step leaves a notch of the form of the
// edge, and a ridge between two of them: a triangle over the step, whose other sides are the edge's
// two faces, if the motion passes between these. A cylinder that is fed sideways leaves none; leant
// by 9° along its feed it leaves ridges of 0.15 of the step on its floor.
#pragma once

#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/core/geometry.h"

namespace toothprep {

class EdgeRidges {
 public:
  explicit EdgeRidges(const Bur& bur);
  // Height of the highest of its ridges over the step, of a motion along the unit vector (B).
  double height_per_step(const Vec3& along) const noexcept;

 private:
  struct Edge {  // outward normals of its two faces, (r, z)
    double before_r, before_z, after_r, after_z;
  };
  std::vector<Edge> edges_;
};

}  // namespace toothprep
