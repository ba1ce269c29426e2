// Text for HTML and SVG: escaped, and numbers as short as a drawing needs them.
#pragma once

#include <string>
#include <string_view>

namespace toothprep {

// Safe in text and in quoted attributes: & < > " ' escaped; control characters and bytes that are
// not UTF-8 become U+FFFD.
std::string escaped(std::string_view text);

// With at most `digits` decimals and no trailing zeros: "12.5", "-3". Not finite: "0" (a drawing
// must stay well-formed; callers don't draw such values).
std::string short_number(double value, int digits = 2);

std::string base64(std::string_view bytes);

// At least `least` and, if it can be, at most twice as many ticks: the step is 1, 2 or 5 times a
// power of ten. `span` above 0.
double tick_step(double span, int least);
// A tick's label with the decimals that its step needs.
std::string tick_text(double value, double step);

}  // namespace toothprep
