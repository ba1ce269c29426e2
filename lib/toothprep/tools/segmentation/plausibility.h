// Whether what was taken for enamel and dentin can be so: a scan of a tooth without enamel (a stump
// prepared for a crown, a root) has two bright classes too, dentin and pulp.
//
// A tooth's enamel is a layer: it faces the outside on one side and dentin on the other, and there is
// not much more of it than of the dentin, which reaches the outside at the root or at a cut. Its grey
// is 1.2 to 2 times as far from the surroundings' as dentin's is.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "toothprep/tools/segmentation/grey_classes.h"
#include "toothprep/tools/segmentation/tooth_fields.h"

namespace toothprep {

// Volumes and faces of voxels, of a tooth whose tissues are found but not yet measured.
struct Layers {
  double enamel = 0, dentin = 0, pulp = 0;                   // voxels
  double enamel_air = 0, enamel_dentin = 0, dentin_air = 0;  // faces between them
};
Layers layers_of(const WorkBox& box, const ToothFields& fields);

// Why these can't be a tooth's enamel and dentin, and which thresholds a tooth without enamel would
// have; empty if they can.
std::string implausible_layers(const Layers& layers, const GreyClasses& classes);

}  // namespace toothprep
