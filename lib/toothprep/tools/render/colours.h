// Colours, in linear light with sRGB's primaries.
#pragma once

#include <Eigen/Core>

#include "toothprep/step/core/tissue.h"

namespace toothprep {

using Colour = Eigen::Array3f;  // linear, 0 to 1

[[nodiscard]] Colour colour_from_srgb(int red, int green, int blue);  // 0 to 255 each
[[nodiscard]] float srgb_from_linear(float linear);                   // 0 to 1 both, clamped

// Of a surface under white light. Air: of a surface of which nothing is known.
[[nodiscard]] Colour tissue_colour(Tissue tissue);

// diverging_srgb() in linear light; grey for NaN.
[[nodiscard]] Colour diverging_colour(float value);

}  // namespace toothprep
