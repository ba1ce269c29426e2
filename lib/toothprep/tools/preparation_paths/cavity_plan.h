// Class I and class II cavities for a tooth: outline along its main fissure, a flat pulpal floor
// square to the occlusal axis, and for class II a box through one marginal ridge.
//
// The frame of the grid has z occlusal. For class II its x axis points to the side of the box.
// Throws Error for what can't be made: a bur wider than the cavity, a crown without a fissure, no
// space for a box between pulpal floor and neck, or beside a neighbour.
#pragma once

#include <optional>
#include <vector>

#include "toothprep/tools/preparation_paths/crown_map.h"
#include "toothprep/tools/preparation_paths/plan.h"

namespace toothprep {

struct CavityShape {                  // its sizes
  double width = 1.4;                 // mm, buccolingual
  double depth = 1.8;                 // mm, floor below the surface, in the median over the floor
  std::optional<double> into_dentin;  // mm: in place of `depth`, so far below the border everywhere
  double ridge = 1.6;                 // mm of marginal ridge that stays
  double longest = 5;                 // mm of fissure
  double layer = 0.45;                // mm, thickest roughing layer
  // Class II, the box:
  double box_width = 3.2;                // mm, buccolingual
  double axial_depth = 1.35;             // mm, from the proximal surface to the axial wall
  std::optional<double> gingival_below;  // mm, gingival floor below the pulpal; else by the contact
                                         // and the neck
};

struct CavityGround {                // what a cavity is planned on
  std::optional<Vec2> fossa;         // in the grid's frame
  std::optional<Vec2> along;         // mesial or distal; needed for class II
  std::vector<SurfacePlace> others;  // of neighbours and gum (surface_of_others())
  double clear = 0.1;                // mm, that the head keeps from them in a box
};

// The path of a class I cavity.
[[nodiscard]] Plan plan_class1(const ToothGrid& grid, const Bur& bur, const CavityShape& shape,
                               const CavityGround& ground);
// The path of a class II cavity: occlusal part and box.
[[nodiscard]] Plan plan_class2(const ToothGrid& grid, const Bur& bur, const CavityShape& shape,
                               const CavityGround& ground);

}  // namespace toothprep
