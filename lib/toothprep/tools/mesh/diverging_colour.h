// The colours of a signed length on a surface, the same in pictures and in files.
#pragma once

#include <array>

namespace toothprep {

// sRGB, 0 to 255: blue (-1) over white (0) to red (1), beyond the ends the ends'. Even steps look
// even, and lightness tells the magnitude: ColorBrewer's RdBu reversed, without its two darkest
// classes, which shade would turn black (Harrower and Brewer, Cartogr J 2003;40:27-37).
// `value` is not NaN.
std::array<float, 3> diverging_srgb(float value);

}  // namespace toothprep
