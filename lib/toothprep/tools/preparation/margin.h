// The margin of a crown preparation: the ledge between the axial walls and the finish line.
#pragma once

#include <vector>

#include "toothprep/tools/preparation/walls.h"

namespace toothprep {

struct Margin {
  Weighted width;         // mm, along the finish line
  double continuity = 0;  // share of the circumference with a margin wider than kNoMargin, 0..1
};
constexpr double kNoMargin = 0.2;  // mm

// At each point of the finish line the horizontal distance to the axial wall, extended down to that
// point's height: so a shoulder, a chamfer and a bevel are measured alike. The wall is the mean of
// the dozen facets of middle thirds nearest to the point. The circumference is taken in steps of
// 5° about the middle of the walls; a step without finish line counts as without margin. What lies
// less than `tolerance` (mm) inside the original doesn't count as cut, so that strip is added.
Margin measure_margin(const CutFacets& facets, const std::vector<WallFacet>& walls,
                      const PreparationFrame& frame, double tolerance);

}  // namespace toothprep
