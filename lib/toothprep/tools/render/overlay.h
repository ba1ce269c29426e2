// What is drawn over a finished picture: scale bar, colour bar, arrows with letters. Its digits and
// letters are strokes, so no font is needed.
#pragma once

#include <array>
#include <string_view>
#include <vector>

#include "toothprep/tools/render/image.h"

namespace toothprep {

// A bar of a round length (1, 2 or 5 times a power of ten), at most a quarter of the picture wide,
// with its length in mm; lower left.
void draw_scale_bar(Picture& picture, double mm_per_pixel);

// The colours of the deviation from -range to range with numerals, mm; right.
void draw_colour_bar(Picture& picture, double range_mm);

// From one place to another (mm, W), with a head and, beyond it, a text of the letters A, B, D, L,
// M, O and digits.
void draw_arrow(Picture& picture, const Camera& camera, const Vec3& from, const Vec3& to,
                std::string_view text);

void draw_place(Picture& picture, const Camera& camera, const Vec3& at);  // a dot, `at` in W, mm

// A line through places (mm, W), of a colour (sRGB, 0 to 255).
void draw_line(Picture& picture, const Camera& camera, const std::vector<Vec3>& places,
               const std::array<int, 3>& colour);

// The directions that are known, as arrows O, M, B; upper right. Nothing if none is.
void draw_triad(Picture& picture, const Camera& camera, const ToothAxes& axes);

}  // namespace toothprep
