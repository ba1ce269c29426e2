// How smooth a preparation is: roughness of its surfaces, and the rounding of its inner line
// angles.
#pragma once

#include "toothprep/tools/preparation/walls.h"

namespace toothprep {

// RMS distance (mm) of facets from the quadratic surface fitted to what lies within 0.4 mm around
// them, away from line angles (neighbours whose normals differ by more than 30° don't count): form
// is taken out, marks of the bur stay. Mean over at most 600 places, evenly among the facets; NaN
// where none has enough neighbours.
double surface_roughness(const CutFacets& facets);

// Radius (mm) of the rounding between walls and the floor at their foot: where the slope of a
// wall's middle third meets the floor's plane, the surface stays a gap g away, and a circle that
// touches both has r = g / (1/sin(angle/2) - 1). Medians over area; NaN if no wall stands on a
// floor.
struct LineAngles {
  double radius = 0;     // mm
  double angle_deg = 0;  // between wall and floor
};
LineAngles line_angle_radius(const CutFacets& facets, const std::vector<WallFacet>& walls,
                             const std::vector<Floor>& floors, const PreparationFrame& frame,
                             const TriangleTree& prepared);

}  // namespace toothprep
