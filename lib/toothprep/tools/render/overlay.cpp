#include "toothprep/tools/render/overlay.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string_view>

namespace toothprep {
namespace {

using Point = Eigen::Vector2d;

// Strokes on a grid, x then y (downward, 6 is the base line); a bar lifts the pen.
struct Glyph {
  char symbol;
  double advance;
  std::string_view strokes;
};
constexpr Glyph kGlyphs[] = {
    {'0', 6, "103041453616050110"},
    {'1', 6, "112026"},
    {'2', 6, "01103041420646"},
    {'3', 6, "0110304142334445361605|1333"},
    {'4', 6, "36300444"},
    {'5', 6, "40000312324345361605"},
    {'6', 6, "413010010516364543321203"},
    {'7', 6, "00404116"},
    {'8', 6, "103041423313020110|1304051636454433"},
    {'9', 6, "051636454130100103143443"},
    {'.', 2, "0606"},
    {'-', 6, "0343"},
    {'+', 6, "0343|2125"},
    {'A', 6, "062046|1434"},
    {'B', 6, "06003041423303|3344453606"},
    {'D', 6, "00204244260600"},
    {'L', 6, "000646"},
    {'M', 6, "0600234046"},
    {'O', 6, "103041453616050110"},
    {'m', 8, "0206|0312223336|3342526366"},
    {' ', 3, ""},
};

const Glyph& glyph_of(char symbol) {
  const auto found = std::find_if(std::begin(kGlyphs), std::end(kGlyphs),
                                  [&](const Glyph& g) { return g.symbol == symbol; });
  return found != std::end(kGlyphs) ? *found : *(std::end(kGlyphs) - 1);
}

using Ink = std::array<int, 3>;  // sRGB, 0 to 255
constexpr Ink kInk = {45, 45, 45};

void blend(Picture& picture, int x, int y, double alpha, const Ink& ink) {
  if (x < 0 || y < 0 || x >= picture.width || y >= picture.height || alpha <= 0) return;
  const std::size_t p = 3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(picture.width) +
                             static_cast<std::size_t>(x));
  for (std::size_t k = 0; k < 3; ++k)
    picture.rgb[p + k] =
        static_cast<std::uint8_t>(std::lround((1 - alpha) * picture.rgb[p + k] + alpha * ink[k]));
}

// A stroke with round ends: a pixel is covered as far as its centre lies within.
void draw_stroke(Picture& picture, const Point& a, const Point& b, double width,
                 const Ink& ink = kInk) {
  const double reach = 0.5 * width + 1;
  const Point low = a.cwiseMin(b).array() - reach, high = a.cwiseMax(b).array() + reach;
  const Point along = b - a;
  for (int y = static_cast<int>(low.y()); y <= static_cast<int>(high.y()); ++y)
    for (int x = static_cast<int>(low.x()); x <= static_cast<int>(high.x()); ++x) {
      const Point c(x + 0.5, y + 0.5);
      const double length2 = along.squaredNorm();
      const double t = length2 > 0 ? std::clamp((c - a).dot(along) / length2, 0.0, 1.0) : 0.0;
      const double distance = (c - a - t * along).norm();
      blend(picture, x, y, std::clamp(0.5 * width + 0.5 - distance, 0.0, 1.0), ink);
    }
}

double text_width(std::string_view text, double height) {
  double width = -2;
  for (const char c : text) width += glyph_of(c).advance;
  return width * height / 6;
}

// `at` is the left end of the base line; capitals are `height` pixels high.
void draw_text(Picture& picture, std::string_view text, Point at, double height) {
  const double unit = height / 6, width = std::max(1.2, 0.13 * height);
  for (const char c : text) {
    const Glyph& glyph = glyph_of(c);
    bool down = false;
    Point last = Point::Zero();
    for (std::size_t i = 0; i < glyph.strokes.size();) {
      if (glyph.strokes[i] == '|') {
        down = false;
        ++i;
        continue;
      }
      const Point next = at + unit * Point(glyph.strokes[i] - '0', glyph.strokes[i + 1] - '6');
      if (down) draw_stroke(picture, last, next, width);
      last = next;
      down = true;
      i += 2;
    }
    at.x() += unit * glyph.advance;
  }
}

double text_height(const Picture& picture) { return std::max(8.0, picture.height / 62.0); }

}  // namespace

void draw_scale_bar(Picture& picture, double mm_per_pixel) {
  const double longest = 0.25 * picture.width * mm_per_pixel;
  if (!(longest > 0 && std::isfinite(longest))) return;
  const double decade = std::pow(10.0, std::floor(std::log10(longest)));
  const double length = longest >= 5 * decade   ? 5 * decade
                        : longest >= 2 * decade ? 2 * decade
                                                : decade;
  const double margin = 0.04 * picture.height, height = text_height(picture);
  const Point left(margin, picture.height - margin);
  const Point right = left + Point(length / mm_per_pixel, 0);
  const double width = std::max(1.5, picture.height / 400.0);
  draw_stroke(picture, left, right, width);
  for (const Point& end : {left, right})
    draw_stroke(picture, end - Point(0, 0.3 * height), end + Point(0, 0.3 * height), width);
  draw_text(picture, fmt::format("{:g} mm", length), left - Point(0, 0.8 * height), height);
}

void draw_colour_bar(Picture& picture, double range_mm) {
  const double height = text_height(picture), margin = 0.04 * picture.height;
  const int bar_height = static_cast<int>(0.5 * picture.height);
  const int bar_width = std::max(6, static_cast<int>(1.1 * height));
  const int top = (picture.height - bar_height) / 2;
  const std::string widest = fmt::format("+{:.3g}", range_mm);
  const double label = text_width(widest, height) + 0.8 * height;
  const int left = static_cast<int>(picture.width - margin - label) - bar_width;
  for (int y = 0; y < bar_height; ++y) {
    const Colour c =
        diverging_colour(1 - 2 * (static_cast<float>(y) + 0.5f) / static_cast<float>(bar_height));
    for (int x = 0; x < bar_width; ++x) {
      if (left + x < 0 || left + x >= picture.width) continue;
      const std::size_t p =
          3 * (static_cast<std::size_t>(top + y) * static_cast<std::size_t>(picture.width) +
               static_cast<std::size_t>(left + x));
      for (int k = 0; k < 3; ++k)
        picture.rgb[p + k] = static_cast<std::uint8_t>(255 * srgb_from_linear(c[k]) + 0.5f);
    }
  }
  const double right = left + bar_width;
  for (int tick = -2; tick <= 2; ++tick) {
    const double y = top + bar_height * (0.5 - 0.25 * tick);
    draw_stroke(picture, Point(right, y), Point(right + 0.4 * height, y),
                std::max(1.0, height / 10));
    const std::string text = tick == 0 ? "0" : fmt::format("{:+.3g}", 0.5 * tick * range_mm);
    draw_text(picture, text, Point(right + 0.8 * height, y + 0.5 * height), height);
  }
  draw_text(picture, "mm", Point(left, top - height), height);
}

namespace {

Point pixel_of(const Camera& camera, const Vec3& x) {
  const Vec3 off = (x - camera.origin) / camera.mm_per_pixel;
  return {0.5 * camera.width + off.dot(camera.right), 0.5 * camera.height - off.dot(camera.up)};
}

void draw_arrow_between(Picture& picture, const Point& from, const Point& to,
                        std::string_view text) {
  const double height = text_height(picture), width = std::max(1.5, picture.height / 400.0);
  const Point along = to - from;
  draw_stroke(picture, from, to, width);
  const double length = along.norm();
  const Point out = length > 1e-6 ? Point(along / length) : Point(0, -1);
  if (length > 0.5 * height) {
    const Point side(-out.y(), out.x());
    for (const double way : {-1.0, 1.0})
      draw_stroke(picture, to, to - 0.6 * height * out + way * 0.3 * height * side, width);
  }
  const Point middle = to + 1.1 * height * out;
  draw_text(picture, text, middle + Point(-0.5 * text_width(text, height), 0.5 * height), height);
}

}  // namespace

void draw_arrow(Picture& picture, const Camera& camera, const Vec3& from, const Vec3& to,
                std::string_view text) {
  draw_arrow_between(picture, pixel_of(camera, from), pixel_of(camera, to), text);
}

void draw_place(Picture& picture, const Camera& camera, const Vec3& at) {
  const Point p = pixel_of(camera, at);
  draw_stroke(picture, p, p, std::max(3.0, picture.height / 110.0));
}

void draw_line(Picture& picture, const Camera& camera, const std::vector<Vec3>& places,
               const std::array<int, 3>& colour) {
  Point last = Point::Zero();
  for (std::size_t i = 0; i < places.size(); ++i) {
    const Point p = pixel_of(camera, places[i]);
    if (i > 0 && (p - last).norm() < 0.5 && i + 1 < places.size()) continue;
    if (i > 0) draw_stroke(picture, last, p, std::max(1.0, picture.height / 500.0), colour);
    last = p;
  }
}

void draw_triad(Picture& picture, const Camera& camera, const ToothAxes& axes) {
  const double length = 3.5 * text_height(picture);
  const Point corner(picture.width - 2.2 * length, 2.2 * length);
  const auto way = [&](bool known, const Vec3& axis) {
    return known ? Point(axis.dot(camera.right), -axis.dot(camera.up)) : Point(0, 0);
  };
  const Point all = way(axes.occlusal_known, axes.occlusal) + way(axes.mesial_known, axes.mesial) +
                    way(axes.buccal_known, axes.buccal);
  const auto arrow = [&](bool known, const Vec3& axis, std::string_view letter) {
    if (!known) return;
    Point tip = length * way(known, axis);
    if (tip.norm() < 0.5 * text_height(picture))
      tip = -1e-3 * all;  // along the view: only a letter
    draw_arrow_between(picture, corner, corner + tip, letter);
  };
  arrow(axes.occlusal_known, axes.occlusal, "O");
  arrow(axes.mesial_known, axes.mesial, "M");
  arrow(axes.buccal_known, axes.buccal, "B");
}

}  // namespace toothprep
