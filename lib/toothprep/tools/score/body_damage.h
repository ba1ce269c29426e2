// What was done to neighbours and gum: bodies of the original tooth file that aren't to be touched.
#pragma once

#include "toothprep/tools/compare/solid.h"
#include "toothprep/tools/preparation/quantity.h"

namespace toothprep {

// Adds body_removed_mm3.NAME and body_depth_mm.NAME of each, and of all neighbours, and of all gum,
// neighbour_damage_mm3, neighbour_depth_mm, gum_damage_mm3 and gum_depth_mm, in place of what is
// there under these keys. Volumes by voxels, as compare/volumes.h has them: max(0, f_o - f_p), where
// that is above `tolerance` mm over the voxel size (what resampling and registration make of
// surfaces that coincide); removed_mm3.total is left with what was removed of the prepared tooth. Depths are distances from the prepared surface to the original's. Of an
// original without bodies nothing is added.
void add_body_damage(const Solid& original, const Solid& prepared, double voxel, double tolerance,
                     Quantities& quantities);

}  // namespace toothprep
