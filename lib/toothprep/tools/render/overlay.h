// What is drawn over a finished picture, in the picture's own pixels: scale bar, colour bar. Its
// digits are strokes, so no font is needed.
#pragma once

#include "toothprep/tools/render/image.h"

namespace toothprep {

// A bar of a round length (1, 2 or 5 times a power of ten), at most a quarter of the picture wide,
// with its length in mm; lower left.
void draw_scale_bar(Picture& picture, double mm_per_pixel);

// The colours of the deviation from -range to range with numerals, mm; right.
void draw_colour_bar(Picture& picture, double range_mm);

}  // namespace toothprep
