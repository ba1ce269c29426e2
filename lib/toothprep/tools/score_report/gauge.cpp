#include "toothprep/tools/score_report/gauge.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "toothprep/tools/score/definitions.h"
#include "toothprep/tools/score_report/markup.h"

namespace toothprep {
namespace {

constexpr double kWidth = 190, kHeight = 30, kRim = 8;  // px
constexpr double kTop = 6, kBar = 10;

std::string band(double from, double to, const char* style) {
  if (!(to > from)) return {};
  return std::string("<rect class=\"") + style + "\" x=\"" + short_number(from) + "\" y=\"" +
         short_number(kTop) + "\" width=\"" + short_number(to - from) + "\" height=\"" +
         short_number(kBar) + "\"/>";
}

}  // namespace

std::string gauge_svg(const CriterionResult& r) {
  const Criterion& c = r.criterion;
  if (!r.value || c.unit == "yes/no") return {};
  std::vector<double> limits;
  for (const double x : {c.ideal.low, c.ideal.high, c.tolerated.low, c.tolerated.high})
    if (std::isfinite(x)) limits.push_back(x);
  if (c.hard_fail)
    for (const double x : {c.hard_fail->low, c.hard_fail->high})
      if (std::isfinite(x)) limits.push_back(x);
  const auto [least, most] = std::minmax_element(limits.begin(), limits.end());
  double span = *most - *least;
  if (!(span > 0)) span = *most != 0 ? std::abs(*most) : 1;
  double low = *least - 0.5 * span, high = *most + 0.5 * span;
  // What can't be negative isn't drawn so.
  if (*least >= 0 && *r.value >= 0) low = std::max(low, 0.0);
  // A value somewhat further out is brought in; one far out gets an arrow at the rim.
  if (*r.value<low&& * r.value> low - span) low = *r.value - 0.1 * span;
  if (*r.value > high && *r.value < high + span) high = *r.value + 0.1 * span;
  const auto x = [&](double v) {
    return kRim + (std::clamp(v, low, high) - low) / (high - low) * (kWidth - 2 * kRim);
  };

  std::string svg = "<svg class=\"gauge\" role=\"img\" aria-label=\"" +
                    escaped(value_text(*r.value, c.unit)) +
                    "\" viewBox=\"0 0 190 30\" width=\"190\" "
                    "height=\"30\">";
  svg += band(x(low), x(high), "g-outside");
  if (c.hard_fail)
    svg +=
        band(x(low), x(c.hard_fail->low), "g-fail") + band(x(c.hard_fail->high), x(high), "g-fail");
  svg += band(x(c.tolerated.low), x(c.tolerated.high), "g-tolerated");
  svg += band(x(c.ideal.low), x(c.ideal.high), "g-ideal");
  const double middle = kTop + kBar / 2, at = x(*r.value);
  if (std::isfinite(r.uncertainty) && r.uncertainty > 0) {
    const double from = x(*r.value - r.uncertainty), to = x(*r.value + r.uncertainty);
    if (to - from > 9)
      svg += "<line class=\"g-whisker\" x1=\"" + short_number(from) + "\" y1=\"" +
             short_number(middle) + "\" x2=\"" + short_number(to) + "\" y2=\"" +
             short_number(middle) + "\"/>";
  }
  if (*r.value < low || *r.value > high) {
    const double way = *r.value < low ? -1 : 1;
    svg += "<path class=\"g-mark\" d=\"M" + short_number(at + way * 7) + " " +
           short_number(middle) + "L" + short_number(at - way * 2) + " " +
           short_number(middle - 6) + "L" + short_number(at - way * 2) + " " +
           short_number(middle + 6) + "Z\"/>";
  } else {
    svg += "<path class=\"g-mark\" d=\"M" + short_number(at) + " " + short_number(middle - 6.5) +
           "L" + short_number(at + 4.5) + " " + short_number(middle) + "L" + short_number(at) +
           " " + short_number(middle + 6.5) + "L" + short_number(at - 4.5) + " " +
           short_number(middle) + "Z\"/>";
  }
  // The ideal's ends in figures, unless they would lie on each other.
  double written = -100;
  for (const double v : {c.ideal.low, c.ideal.high}) {
    if (!std::isfinite(v)) continue;
    const double place = std::clamp(x(v), 14.0, kWidth - 14);
    if (place - written < 26) continue;
    svg += "<text class=\"g-text\" text-anchor=\"middle\" x=\"" + short_number(place) +
           "\" y=\"27\">" + short_number(v, 3) + "</text>";
    written = place;
  }
  return svg + "</svg>";
}

}  // namespace toothprep
