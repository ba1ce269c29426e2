// Landmarks: places on a tooth that a person picked, as a file.
//
//   occlusal_mm = [[x, y, z], ...]   three or more places of the occlusal plane (cusp tips)
//   apical_mm = [x, y, z]            a place at the root's end: says which side of that plane is up,
//                                    or, with `crown_mm`, gives the direction by itself
//   crown_mm = [x, y, z]             a place at the crown's end
//   mesial_mm, distal_mm = [x, y, z]     of the two sides one place each, or of one side a place and
//   buccal_mm, lingual_mm = [x, y, z]    `middle_mm` (any place on the tooth's axis)
//   middle_mm = [x, y, z]
//   fossa_mm = [x, y, z]             the deepest place of the central fossa
//   uncertainty_mm = 0.3             of each place (95 %); default 0.3
//   tooth_number = 36                FDI
//
// All keys are optional. A direction's uncertainty is that of the places over their distance.
#pragma once

#include <string>

#include "toothprep/tools/orientation/estimate_frame.h"

namespace toothprep {

// Throws InputError (file, key, condition) for what is not such a file: unknown keys, places that
// coincide or lie on a line, a side without its opposite or a middle, neither a direction nor
// a fossa.
[[nodiscard]] KnownAxes read_landmarks(const std::string& path);
[[nodiscard]] KnownAxes parse_landmarks(const std::string& toml, const std::string& where);

}  // namespace toothprep
