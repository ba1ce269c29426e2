// What stands on the crown: cusp tips, the central fossa, and what kind of crown that makes.
#pragma once

#include <optional>
#include <vector>

#include "toothprep/tools/orientation/label_block.h"
#include "toothprep/tools/orientation/tooth_frame.h"

namespace toothprep {

struct Crown {
  double width = 0;           // mm: the root of its outline's area, seen along d
  double elongation = 1;      // longest half axis of the outline over the one across it
  std::vector<Vec3> cusps;    // mm, W; tips, highest first
  std::optional<Vec3> fossa;  // mm, W
  CrownForm form = CrownForm::kNotKnown;
};

// Seen along `d` (unit, occlusal), on the heights of the surface smoothed over 2.5 % of the width.
// A cusp stands 2.5 % of the width above the pass to a higher one (0.26 mm of a molar) and in the
// upper half of the crown; the central fossa is the deepest basin in the middle third that would
// hold 1.5 % of the width of water. All lengths are relative, so that an unknown voxel size doesn't
// matter. `neck` is the height of the cervical line along d, if that is known.
Crown describe_crown(const LabelBlock& block, const Vec3& d, std::optional<double> neck);

}  // namespace toothprep
