// A section of a tooth as an inline SVG: what was removed, what is left, the target, pulp and
// dentin, with the measured angles and widths. Equal aspect, a scale bar in mm, a grid of 1 mm.
#pragma once

#include <string>

#include "toothprep/tools/preparation/section.h"

namespace toothprep {

// Colours are the page's CSS classes (page_style.h). Outlines that are cut open at a window's edge
// are filled as if closed when both ends lie on one line along an axis. Marks outside the outlines
// widen the drawing. A section without any point gives an empty drawing with a remark.
std::string section_svg(const Section& section);

// What the fills and lines mean, as HTML.
std::string section_legend(const std::vector<Section>& sections);

}  // namespace toothprep
