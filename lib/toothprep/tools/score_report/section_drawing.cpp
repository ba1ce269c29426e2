#include "toothprep/tools/score_report/section_drawing.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>

#include "toothprep/tools/score_report/markup.h"

namespace toothprep {
namespace {

constexpr double kWidest = 410, kHighest = 400;  // px of the drawing
constexpr double kSectionRim = 14;               // px around the outlines
constexpr double kFont = 13;                     // px

struct Box {
  Vec2 low = Vec2::Constant(1e300), high = Vec2::Constant(-1e300);
  bool empty() const { return !(low.x() <= high.x()); }
  void add(const Vec2& p) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  void add(const std::vector<Outline>& outlines) {
    for (const Outline& o : outlines)
      for (const Vec2& p : o.points)
        if (p.allFinite()) add(p);
  }
  Vec2 size() const { return high - low; }
};

bool overlap(const Box& a, const Box& b) {
  return a.low.x() < b.high.x() && b.low.x() < a.high.x() && a.low.y() < b.high.y() &&
         b.low.y() < a.high.y();
}

// From mm in the plane (y up) to px (y down).
struct View {
  Box mm;
  double scale = 1;  // px per mm
  Vec2 operator()(const Vec2& p) const {
    return {kSectionRim + (p.x() - mm.low.x()) * scale,
            kSectionRim + (mm.high.y() - p.y()) * scale};
  }
  double width() const { return mm.size().x() * scale + 2 * kSectionRim; }
  double height() const { return mm.size().y() * scale + 2 * kSectionRim; }
};

// What the marks are about, with some tooth around: of a whole tooth the roots are left out. With
// no marks, or if that isn't much smaller, everything.
Box shown_part(const Section& s) {
  Box all, marked;
  for (const auto* outlines : {&s.original, &s.prepared, &s.target, &s.pulp, &s.dentin})
    all.add(*outlines);
  for (const SectionMark& m : s.marks)
    for (const Vec2& p : {m.from, m.to})
      if (p.allFinite()) marked.add(p);
  if (marked.empty()) return all;
  if (all.empty()) return marked;
  constexpr double kAround = 2.5;  // mm
  Box part;
  part.low = (marked.low.array() - kAround).matrix().cwiseMax(all.low).cwiseMin(marked.low);
  part.high = (marked.high.array() + kAround).matrix().cwiseMin(all.high).cwiseMax(marked.high);
  if (part.size().y() > 0.7 * all.size().y()) {
    part.low.y() = std::min(all.low.y(), marked.low.y());
    part.high.y() = std::max(all.high.y(), marked.high.y());
  }
  if (part.size().x() > 0.5 * all.size().x()) {
    part.low.x() = std::min(all.low.x(), marked.low.x());
    part.high.x() = std::max(all.high.x(), marked.high.x());
  }
  return part;
}

std::string point_text(const Vec2& p) {
  return short_number(p.x(), 1) + " " + short_number(p.y(), 1);
}

std::string path_of(const Outline& o, const View& view, bool close) {
  std::string d;
  std::string last;
  for (const Vec2& p : o.points) {
    if (!p.allFinite()) continue;
    const std::string at = point_text(view(p));
    if (at == last) continue;  // nothing that a tenth of a pixel could show
    d += (d.empty() ? "M" : "L") + at;
    last = at;
  }
  return d.empty() || !close ? d : d + "Z";
}

// Whether an open outline was cut at a straight edge along an axis, so that this edge closes it.
bool closes_straight(const Outline& o) {
  if (o.points.size() < 3) return false;
  const Vec2 gap = (o.points.back() - o.points.front()).cwiseAbs();
  return gap.minCoeff() < 1e-3 + 1e-3 * gap.maxCoeff();
}

std::string filled(const std::vector<Outline>& outlines, const View& view, const char* style) {
  std::string d;
  for (const Outline& o : outlines)
    if (o.closed || closes_straight(o)) d += path_of(o, view, true);
  if (d.empty()) return {};
  return std::string("<path class=\"") + style + "\" fill-rule=\"evenodd\" d=\"" + d + "\"/>\n";
}

std::string stroked(const std::vector<Outline>& outlines, const View& view, const char* style) {
  std::string d;
  for (const Outline& o : outlines) d += path_of(o, view, o.closed);
  if (d.empty()) return {};
  return std::string("<path class=\"") + style + "\" d=\"" + d + "\"/>\n";
}

std::string line(const Vec2& a, const Vec2& b, const char* style) {
  return std::string("<line class=\"") + style + "\" x1=\"" + short_number(a.x(), 1) + "\" y1=\"" +
         short_number(a.y(), 1) + "\" x2=\"" + short_number(b.x(), 1) + "\" y2=\"" +
         short_number(b.y(), 1) + "\"/>\n";
}

std::size_t characters(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

// Places texts beside their marks so that they don't cover each other, first come first served.
class Labels {
 public:
  explicit Labels(const View& view) : view_(view) {}

  // `along`: the mark's direction, unit, px. Tries places beside the middle and the ends, nearer
  // ones first; takes the first that lies in the drawing and is free, else the first.
  void place(const Vec2& a, const Vec2& b, const std::string& text, const char* style) {
    const Vec2 along = b - a;
    const double length = along.norm();
    const Vec2 unit = length > 1e-9 ? Vec2(along / length) : Vec2(1, 0);
    const Vec2 across(-unit.y(), unit.x());
    const Vec2 half(0.29 * kFont * static_cast<double>(characters(text)) + 2, 0.62 * kFont);
    const double reach = std::abs(across.x()) * half.x() + std::abs(across.y()) * half.y() + 4;
    const Vec2 middle = (a + b) / 2;
    Vec2 best = middle + across * reach;
    bool found = false;
    for (int far = 0; far < 5 && !found; ++far)
      for (const double t : {0.0, 0.35, -0.35, 0.5, -0.5})
        for (const double side : {1.0, -1.0}) {
          const Vec2 c = middle + along * t + across * side * (reach + far * 0.8 * kFont);
          if (!found && free(c, half)) {
            best = c;
            found = true;
          }
        }
    Box taken;
    taken.add(best - half);
    taken.add(best + half);
    taken_.push_back(taken);
    svg_ += std::string("<text class=\"") + style + "\" text-anchor=\"middle\" x=\"" +
            short_number(best.x(), 1) + "\" y=\"" + short_number(best.y() + 0.35 * kFont, 1) +
            "\">" + escaped(text) + "</text>\n";
  }
  // Space that no text may take.
  void keep_free(const Vec2& a, const Vec2& b) {
    constexpr int kPieces = 8;
    for (int i = 0; i < kPieces; ++i) {
      Box box;
      box.add(a + (b - a) * i / kPieces);
      box.add(a + (b - a) * (i + 1) / kPieces);
      box.low.array() -= 1;
      box.high.array() += 1;
      taken_.push_back(box);
    }
  }
  const std::string& svg() const { return svg_; }

 private:
  bool free(const Vec2& c, const Vec2& half) const {
    Box box;
    box.add(c - half);
    box.add(c + half);
    if (box.low.x() < 2 || box.low.y() < 2 || box.high.x() > view_.width() - 2 ||
        box.high.y() > view_.height() - 2)
      return false;
    return std::none_of(taken_.begin(), taken_.end(),
                        [&](const Box& other) { return overlap(box, other); });
  }

  View view_;
  std::vector<Box> taken_;
  std::string svg_;
};

std::string grid(const View& view) {
  std::string svg;
  const Box& mm = view.mm;
  if (mm.size().maxCoeff() > 60) return svg;
  for (double x = std::ceil(mm.low.x()); x <= mm.high.x(); x += 1)
    svg += line(view({x, mm.low.y()}), view({x, mm.high.y()}), "grid");
  for (double y = std::ceil(mm.low.y()); y <= mm.high.y(); y += 1)
    svg += line(view({mm.low.x(), y}), view({mm.high.x(), y}), "grid");
  return svg;
}

std::string scale_bar(const View& view, double y) {
  const double mm = tick_step(140 / view.scale, 2);
  const double length = mm * view.scale;
  const double end = view.width() - kSectionRim, begin = end - length;
  return line({begin, y}, {end, y}, "ruler") + line({begin, y - 4}, {begin, y + 4}, "ruler") +
         line({end, y - 4}, {end, y + 4}, "ruler") +
         "<text class=\"small\" text-anchor=\"end\" x=\"" + short_number(begin - 6, 1) + "\" y=\"" +
         short_number(y + 4, 1) + "\">" + tick_text(mm, mm) + " mm</text>\n";
}

// Which sides of the tooth lie left and right.
std::string side_names(const Section& s, const View& view) {
  const auto name = [](const std::string& side, const char* anchor, double x) {
    return side.empty() ? std::string()
                        : "<text class=\"small\" text-anchor=\"" + std::string(anchor) + "\" x=\"" +
                              short_number(x, 1) + "\" y=\"16\">" + escaped(side) + "</text>\n";
  };
  return name(s.left_side, "start", 6) + name(s.right_side, "end", view.width() - 6);
}

}  // namespace

std::string section_svg(const Section& s) {
  View view;
  view.mm = shown_part(s);
  if (view.mm.empty()) return "<p class=\"muted\">Nothing lies in this section.</p>\n";
  for (int i = 0; i < 2; ++i)  // a drawing needs some extent
    if (view.mm.size()[i] < 0.1) {
      view.mm.low[i] -= 0.5;
      view.mm.high[i] += 0.5;
    }
  view.scale = std::min(kWidest / view.mm.size().x(), kHighest / view.mm.size().y());

  constexpr double kFoot = 22;  // px for the scale bar
  const std::string width = short_number(view.width(), 1),
                    height = short_number(view.height() + kFoot, 1);
  // The drawing's own name, so that several on a page don't share a clip path.
  std::string id = "clip-";
  for (const char c : s.name) id += std::isalnum(static_cast<unsigned char>(c)) ? c : '-';
  id += "-" + short_number(view.mm.low.x(), 6) + "-" + short_number(view.mm.high.y(), 6);
  std::string svg = "<svg role=\"img\" aria-label=\"" + escaped(s.name) +
                    " section\" viewBox=\"0 0 " + width + " " + height + "\" width=\"" + width +
                    "\" height=\"" + height + "\">\n";
  svg += "<clipPath id=\"" + id + "\"><rect x=\"0\" y=\"0\" width=\"" + width + "\" height=\"" +
         short_number(view.height(), 1) + "\"/></clipPath>\n<g clip-path=\"url(#" + id + ")\">\n";
  svg += filled(s.original, view, "removed");
  svg += filled(s.prepared, view, "tooth");
  svg += filled(s.pulp, view, "pulp");
  svg += grid(view);
  svg += stroked(s.original, view, "original");
  svg += stroked(s.dentin, view, "dentin");
  svg += stroked(s.pulp, view, "pulp-line");
  svg += stroked(s.prepared, view, "prepared");
  svg += stroked(s.target, view, "target");

  Labels labels(view);
  for (const SectionMark& m : s.marks)
    if (m.from.allFinite() && m.to.allFinite()) labels.keep_free(view(m.from), view(m.to));
  for (const SectionMark& m : s.marks) {
    if (!m.from.allFinite() || !m.to.allFinite()) continue;
    const Vec2 a = view(m.from), b = view(m.to);
    const Vec2 along = (b - a).normalized();
    if (m.dimension) {
      const Vec2 tick(-along.y() * 5, along.x() * 5);
      svg += line(a, b, "dimension") + line(a - tick, a + tick, "dimension") +
             line(b - tick, b + tick, "dimension");
    } else {
      svg += line(a - along * 8, b + along * 8, "fit");
    }
    if (!m.text.empty()) labels.place(a, b, m.text, m.dimension ? "label dim" : "label");
  }
  svg += labels.svg() + "</g>\n" + side_names(s, view) + scale_bar(view, view.height() + 10) +
         "</svg>\n";
  return svg;
}

std::string section_legend(const std::vector<Section>& sections) {
  const auto any = [&](std::vector<Outline> Section::*part) {
    return std::any_of(sections.begin(), sections.end(),
                       [&](const Section& s) { return !(s.*part).empty(); });
  };
  std::string html = "<ul class=\"legend\">\n";
  const auto entry = [&](const char* style, const char* text) {
    html += std::string("<li><svg width=\"26\" height=\"14\" viewBox=\"0 0 26 14\">") +
            "<path class=\"" + style + "\" d=\"M2 2L24 2L24 12L2 12Z\"/></svg>" + text + "</li>\n";
  };
  const auto stroke = [&](const char* style, const char* text) {
    html += std::string("<li><svg width=\"26\" height=\"14\" viewBox=\"0 0 26 14\">") +
            "<line class=\"" + style + "\" x1=\"1\" y1=\"7\" x2=\"25\" y2=\"7\"/></svg>" + text +
            "</li>\n";
  };
  if (any(&Section::prepared)) entry("tooth", "prepared tooth");
  if (any(&Section::original)) entry("removed", "removed");
  if (any(&Section::pulp)) entry("pulp", "pulp");
  if (any(&Section::original)) stroke("original", "original surface");
  if (any(&Section::dentin)) stroke("dentin", "dentin");
  if (any(&Section::target)) stroke("target", "target");
  stroke("fit", "fitted wall or floor");
  stroke("dimension", "measured distance");
  return html + "<li class=\"muted\">grid: 1 mm</li>\n</ul>\n";
}

}  // namespace toothprep
