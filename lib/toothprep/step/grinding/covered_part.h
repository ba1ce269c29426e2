// The part of a rectangle on one side of a line: how much of a small piece of the bur's surface
// lies in tissue, and where the middle of that part is.
//
// A field c + a x + b y over [-1, 1]² is negative on the part asked for. With both moments a force
// that varies linearly over the piece is integrated exactly over what is covered: with the share
// alone, and the piece's own middle, every piece at a border errs to the same side.
#pragma once

#include <algorithm>
#include <initializer_list>
#include <utility>

#include "toothprep/step/grinding/four_lanes.h"

namespace toothprep {

template <class T>
struct CoveredPart {
  T share;  // of the rectangle, 0 .. 1
  T x, y;   // middle of the covered part, -1 .. 1
};

// By the field's value c in the middle and its half ranges a and b along x and y. Shares to 1e-5,
// middles to 1e-3. T is float or Float4.
template <class T>
[[nodiscard]] inline CoveredPart<T> covered_part(T c, T a, T b) noexcept {
  const T zero{}, one = zero + 1;
  const T least_range = zero + 1e-6f;  // keeps the division defined where the field is flat
  const T least_ratio = zero + 0.02f;  // the same for a line along an axis
  const T abs_a = magnitude(a), abs_b = magnitude(b);
  const T larger = greatest(greatest(abs_a, abs_b), least_range);
  const T k = greatest(least(abs_a, abs_b) / larger, least_ratio);
  const T d = least(greatest(c / larger, -one - k), one + k);
  // In the direction of the larger range the part ends at clamp(u), u = -(d + k y); its integrals
  // over y are differences of antiderivatives at both ends of u.
  const T u0 = -d - k, u1 = k - d;
  const T w0 = least(greatest(u0, -one), one), w1 = least(greatest(u1, -one), one);
  const T per_range = 0.5f / k;
  const T first = per_range * (w1 * (u1 - 0.5f * w1) - w0 * (u0 - 0.5f * w0));
  const T second =
      per_range * (w1 * w1 * (u1 - (2.0f / 3) * w1) - w0 * w0 * (u0 - (2.0f / 3) * w0));
  const T cross = per_range * (w1 * (0.5f * u1 * u1 - (1.0f / 6) * (w1 * w1)) -
                               w0 * (0.5f * u0 * u0 - (1.0f / 6) * (w0 * w0)));
  const T share = least(greatest(0.5f + 0.5f * first, zero), one);
  const T per_share = 1 / greatest(share, least_range);
  const T along = 0.25f * (second - 1) * per_share;
  const T across = -per_range * (d * first + cross) * per_share;
  const T p = least(greatest(along, -one), one), q = least(greatest(across, -one), one);
  const T x = abs_b > abs_a ? q : p, y = abs_b > abs_a ? p : q;
  return {share, turned_where_negative(a, x), turned_where_negative(b, y)};
}

// A line c + a x + b y = 0 through that rectangle.
struct DividingLine {
  float c, a, b;
  [[nodiscard]] float at(float x, float y) const noexcept { return c + a * x + b * y; }
  // With its other side the negative one.
  [[nodiscard]] DividingLine turned() const noexcept { return {-c, -a, -b}; }
  // Everything is on its negative side.
  static DividingLine none() noexcept { return {-1, 0, 0}; }
};

// The part of the rectangle on the negative side of several lines. It is cut out as a polygon: by the shares of
// each line alone it isn't known whether they leave out the same or each something else.
[[nodiscard]] inline CoveredPart<float> covered_by_all(
    std::initializer_list<DividingLine> lines) noexcept {
  struct Point {
    float x, y;
  };
  constexpr int kMost = 16;  // a line adds one corner; by rounding alone each could become two
  constexpr float kLeastArea = 1e-6f;
  Point corners[2][kMost];
  Point *polygon = corners[0], *rest = corners[1];
  polygon[0] = {-1, -1}, polygon[1] = {1, -1}, polygon[2] = {1, 1}, polygon[3] = {-1, 1};
  int count = 4;
  for (const DividingLine& line : lines) {
    if (line.c + magnitude(line.a) + magnitude(line.b) < 0) continue;  // it divides nothing
    int left = 0;
    float at_q = count > 0 ? line.at(polygon[0].x, polygon[0].y) : 0;
    for (int i = 0; i < count; ++i) {
      const Point p = polygon[i], q = polygon[i + 1 < count ? i + 1 : 0];
      const float at_p = at_q;
      at_q = line.at(q.x, q.y);
      if (left + 2 > kMost) break;
      if (at_p < 0) rest[left++] = p;
      if ((at_p < 0) == (at_q < 0)) continue;
      const float way = at_p / (at_p - at_q);
      rest[left++] = {p.x + way * (q.x - p.x), p.y + way * (q.y - p.y)};
    }
    count = left;
    std::swap(polygon, rest);
  }
  float area = 0, x = 0, y = 0;  // twice the area, six times its moments
  for (int i = 0; i < count; ++i) {
    const Point p = polygon[i], q = polygon[i + 1 < count ? i + 1 : 0];
    const float cross = p.x * q.y - q.x * p.y;
    area += cross, x += cross * (p.x + q.x), y += cross * (p.y + q.y);
  }
  if (!(area > kLeastArea)) return {0, 0, 0};
  return {area / 8, x / (3 * area), y / (3 * area)};
}

// What is left of a part when one that lies in it is taken away.
[[nodiscard]] inline CoveredPart<float> without(const CoveredPart<float>& all,
                                                const CoveredPart<float>& part) noexcept {
  constexpr float kLeast = 1e-6f;
  const float share = all.share - part.share;
  if (!(share > kLeast)) return {0, 0, 0};
  const auto rest = [&](float whole, float taken) {
    return std::min(std::max((all.share * whole - part.share * taken) / share, -1.0f), 1.0f);
  };
  return {share, rest(all.x, part.x), rest(all.y, part.y)};
}

// Where fields cross four pieces, as lines: tissue lies where value + along x + around y is negative (mm, over
// -1 .. 1 along the axes of a piece).
struct Borders {
  Float4 value, along, around;

  // All of a piece is tissue.
  static Borders none() { return {all4(-1), Float4{}, Float4{}}; }
  [[nodiscard]] CoveredPart<Float4> part() const {
    return covered_part<Float4>(value, along, around);
  }
  void replace(const Int4& where, const Borders& by) {
    value = where ? by.value : value;
    along = where ? by.along : along;
    around = where ? by.around : around;
  }
  [[nodiscard]] DividingLine line(int p) const { return {value[p], along[p], around[p]}; }
};

// What crosses four pieces: the cut, at a ridge or in a groove its other wall, and the tooth's own surface.
struct Crossing {
  Borders cut = Borders::none(), beside = Borders::none(), surface = Borders::none();
  Int4 groove{};    // -1: those two walls make one, so that what lies under either is tissue
  Int4 by_slots{};  // -1: the share is what slots leave, which these lines only resemble

  // What is covered of piece p, under the tooth's surface and another line.
  [[nodiscard]] CoveredPart<float> under_all(int p, const DividingLine& other) const noexcept {
    const DividingLine cut_line = cut.line(p), beside_line = beside.line(p),
                       of_tooth = surface.line(p);
    if (!groove[p]) return covered_by_all({cut_line, beside_line, of_tooth, other});
    return without(covered_by_all({of_tooth, other}),
                   covered_by_all({cut_line.turned(), beside_line.turned(), of_tooth, other}));
  }
};

}  // namespace toothprep
