// The margin of a crown preparation: the ledge between the axial walls and the finish line.
#pragma once

#include <vector>

#include "toothprep/tools/preparation/walls.h"

namespace toothprep {

struct Margin {
  Weighted width;         // mm, along the finish line
  double continuity = 0;  // share of the circumference with a margin wider than kNoMargin, 0..1
  double roughness = 0;   // mm, RMS, of the finish line; NaN if there is none
};
constexpr double kNoMargin = 0.2;          // mm
constexpr double kFinishLineReach = 0.75;  // mm

// At each point of the finish line the horizontal distance to the axial wall, extended down to that
// point's height: so a shoulder, a chamfer and a bevel are measured alike. The wall is the mean of
// the dozen facets of middle thirds nearest to the point. The circumference is taken in steps of
// 5° about the middle of the walls; a step without finish line counts as without margin. What lies
// less than `tolerance` (mm) inside the original doesn't count as cut, so that strip is added.
//
// Roughness: RMS distance of `finish_line` (that of the facets, or a sharper one) from the quadratic
// curve fitted to what lies within kFinishLineReach of each of its points, along the axis and
// across. Of waves 0.5, 1, 1.5 and 2.5 mm long that is the share 0.92, 0.75, 0.24 and 0.04.
Margin measure_margin(const CutFacets& facets, const std::vector<WallFacet>& walls,
                      const PreparationFrame& frame, double tolerance,
                      const std::vector<FinishSegment>& finish_line);

}  // namespace toothprep
