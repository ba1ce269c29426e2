// Labels carried a little way into the air beside the surface.
#pragma once

#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep {

// So many layers of air voxels within `reach` (mm) of the solid's surface take the label of their
// nearest labelled neighbour (faces before edges before corners, then by place).
[[nodiscard]] LabelGrid extended_labels(const LabelGrid& labels, const LevelSet& solid, float reach,
                                        int layers);

}  // namespace toothprep
