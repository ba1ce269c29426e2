// A full crown for a tooth: the occlusal surface lowered by an even amount, axial walls with a taper,
// and a margin all around that follows the neck.
//
// The frame of the grid has z occlusal. Walls and margin are offsets of the tooth's own outline: at
// `above_neck` over the enamel's lower border, which is smoothed around the tooth, the wall's foot
// lies `margin_width` inside the outline. The bur leans over the crown by the taper less its own
// flank; its flat end makes the shoulder (a rounded end a chamfer). Throws Error for a crown without
// a neck or with too little height over it, and for a bur whose end is narrower than the margin.
#pragma once

#include "toothprep/tools/preparation_paths/plan.h"

namespace toothprep {

struct CrownShape {           // its sizes
  double reduction = 1.8;     // mm, occlusal, along the axis
  double margin_width = 1.0;  // mm
  double above_neck = 0.7;    // mm, of the margin
  double taper = 6;           // degrees per wall
};

// The path of a full crown.
[[nodiscard]] Plan plan_crown(const ToothGrid& grid, const Bur& bur, const CrownShape& shape);

}  // namespace toothprep
