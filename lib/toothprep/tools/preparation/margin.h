// The margin of a crown preparation: the ledge between the axial walls and the finish line.
#pragma once

#include <vector>

#include "toothprep/tools/preparation/walls.h"

namespace toothprep {

// A place of the finish line with the wall above it.
struct MarginStation {
  Vec3 at = Vec3::Zero();            // mm, W: on the finish line
  Vec3 across = Vec3::UnitX();       // unit, W: from the wall outwards, across the axis
  Vec3 wall_normal = Vec3::UnitX();  // unit, W
  double width = 0;                  // mm
};

// Where the margin is missing, about the middle of the walls.
struct MarginGap {
  double middle = 0, angle = 0;  // radians, from u to v
  double length = 0;             // mm: its angle times the finish line's mean distance at its ends
};

struct Margin {
  Weighted width;         // mm, along the finish line
  double continuity = 0;  // share of the circumference with a margin wider than kNoMargin, 0..1
  double roughness = 0;   // mm, RMS, of the finish line; NaN if there is none
  std::vector<MarginStation> stations;  // one in each step of 5° that has a finish line
  std::vector<MarginGap> gaps;          // of kLeastGap and two voxels at least
};
constexpr double kNoMargin = 0.2;          // mm
constexpr double kLeastGap = 0.2;          // mm
constexpr double kFinishLineReach = 0.75;  // mm

// At each point of the finish line the horizontal distance to the axial wall, extended down to that
// point's height: so a shoulder, a chamfer and a bevel are measured alike. The wall is the plane
// fitted to middle thirds within 0.25 mm along the finish line. The circumference is taken in steps
// of 5° about the middle of the walls; a step without finish line counts as without margin. What
// lies less than `tolerance` (mm) inside the original doesn't count as cut, so that strip is added.
//
// Roughness: RMS distance of `finish_line` (that of the facets, or a sharper one) from the quadratic
// curve fitted to what lies within kFinishLineReach of each of its points, along the axis and
// across. Of waves 0.5, 1, 1.5 and 2.5 mm long that is the share 0.92, 0.75, 0.24 and 0.04.
//
// Gaps: what is left of the circumference when every piece of the finish line with a margin wider
// than kNoMargin covers the angle between its ends.
Margin measure_margin(const CutFacets& facets, const std::vector<WallFacet>& walls,
                      const PreparationFrame& frame, double tolerance, double voxel,
                      const std::vector<FinishSegment>& finish_line);

}  // namespace toothprep
