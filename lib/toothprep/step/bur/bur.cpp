#include "toothprep/step/bur/bur.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "toothprep/step/bur/distance_kernels.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

using units::kPi;
using Kind = ProfilePiece::Kind;

struct ArcEnd {
  double angle, r, z;
};

// Adds the part of an arc between two angles (counter-clockwise) that lies within one half of the
// circle, the right one if cos >= 0 in between.
void add_arc(DistanceOutline<double>& outline, const ProfilePiece& piece, double radius,
             const ArcEnd& from, const ArcEnd& to) {
  // Multiples of pi/2 are made exact: a circle centred on the axis faces all of r >= 0, to the last
  // bit.
  const auto direction = [](double angle, double& r, double& z) {
    const bool exact = std::abs(angle - std::round(angle / (kPi / 2)) * (kPi / 2)) < 1e-14;
    r = exact ? std::round(std::cos(angle)) : std::cos(angle);
    z = exact ? std::round(std::sin(angle)) : std::sin(angle);
  };
  DistanceOutline<double>::Arc arc{};
  direction(0.5 * (from.angle + to.angle), arc.out_r, arc.out_z);
  arc.mid_r = piece.centre_r + radius * arc.out_r;
  arc.mid_z = piece.centre_z + radius * arc.out_z;
  arc.curvature = 1 / radius;
  arc.from_r = from.r;
  arc.from_z = from.z;
  direction(from.angle, arc.from_out_r, arc.from_out_z);
  arc.to_r = to.r;
  arc.to_z = to.z;
  direction(to.angle, arc.to_out_r, arc.to_out_z);
  arc.centre_r = piece.centre_r;
  arc.centre_z = piece.centre_z;
  arc.z_low = std::min(from.z, to.z);
  arc.z_high = std::max(from.z, to.z);
  (arc.out_r >= 0 ? outline.right_arcs : outline.left_arcs).push_back(arc);
}

void add_piece(DistanceOutline<double>& outline, const ProfilePiece& piece) {
  if (piece.kind == Kind::kLine) {
    const double up = piece.z1 >= piece.z0 ? 1 : -1, length = length_of(piece);
    outline.lines.push_back({0.5 * (piece.r0 + piece.r1), 0.5 * (piece.z0 + piece.z1),
                             up * (piece.r1 - piece.r0) / length,
                             up * (piece.z1 - piece.z0) / length, 0.5 * length,
                             std::min(piece.z0, piece.z1), std::max(piece.z0, piece.z1)});
    return;
  }
  const ArcSpan span = arc_span(piece);
  // Counter-clockwise, cut where the circle turns in z: at pi/2 + k pi.
  ArcEnd from = {span.start, piece.r0, piece.z0};
  ArcEnd end = {span.start + span.sweep, piece.r1, piece.z1};
  if (span.sweep < 0) std::swap(from, end);
  for (double k = std::floor((from.angle - kPi / 2) / kPi) + 1;; ++k) {
    const double cut = kPi / 2 + k * kPi;
    if (cut <= from.angle + 1e-12) continue;
    if (cut >= end.angle - 1e-12) break;
    const ArcEnd top = {cut, piece.centre_r,
                        piece.centre_z + span.radius * std::round(std::sin(cut))};
    add_arc(outline, piece, span.radius, from, top);
    from = top;
  }
  add_arc(outline, piece, span.radius, from, end);
}

// Is the end of the outline that lies on the axis never the only nearest point of a place with r >=
// 0? So it is where an arc centred on the axis ends: it leaves the axis at a right angle.
bool leaves_axis_squarely(const ProfilePiece& piece) {
  return piece.kind == Kind::kArc && std::abs(piece.centre_r) < 1e-12;
}

DistanceOutline<double> outline_of(const std::vector<ProfilePiece>& pieces) {
  DistanceOutline<double> outline;
  for (const ProfilePiece& piece : pieces) add_piece(outline, piece);
  // Lines measure to their ends themselves; any other joint is a point of its own.
  for (std::size_t i = 0; i + 1 < pieces.size(); ++i)
    if (pieces[i].kind == Kind::kArc && pieces[i + 1].kind == Kind::kArc)
      outline.points.push_back({pieces[i].r1, pieces[i].z1});
  const ProfilePiece &first = pieces.front(), &last = pieces.back();
  if (first.kind == Kind::kArc && !leaves_axis_squarely(first))
    outline.points.push_back({first.r0, first.z0});
  if (last.kind == Kind::kArc && !leaves_axis_squarely(last))
    outline.points.push_back({last.r1, last.z1});
  return outline;
}

DistanceOutline<float> in_float(const DistanceOutline<double>& from) {
  const auto f = [](double value) { return static_cast<float>(value); };
  DistanceOutline<float> to;
  for (const auto& p : from.lines)
    to.lines.push_back(
        {f(p.mid_r), f(p.mid_z), f(p.u_r), f(p.u_z), f(p.half_length), f(p.z_low), f(p.z_high)});
  const auto arc = [&](const DistanceOutline<double>::Arc& p) {
    return DistanceOutline<float>::Arc{
        f(p.mid_r),    f(p.mid_z),      f(p.out_r),      f(p.out_z), f(p.curvature), f(p.from_r),
        f(p.from_z),   f(p.from_out_r), f(p.from_out_z), f(p.to_r),  f(p.to_z),      f(p.to_out_r),
        f(p.to_out_z), f(p.centre_r),   f(p.centre_z),   f(p.z_low), f(p.z_high)};
  };
  for (const auto& p : from.right_arcs) to.right_arcs.push_back(arc(p));
  for (const auto& p : from.left_arcs) to.left_arcs.push_back(arc(p));
  for (const auto& p : from.points) to.points.push_back({f(p.r), f(p.z)});
  for (const auto& p : from.corners)
    to.corners.push_back({f(p.r), f(p.z), f(p.from_r), f(p.from_z), f(p.to_r), f(p.to_z)});
  return to;
}

constexpr double kGoldenRatio = 0.6180339887498949;

void check_size(double size) {
  if (!(size >= 1e-4 && size <= 10))
    throw Error("bur elements: size must be within 0.0001 .. 10 mm, got " + std::to_string(size));
}

// Appends the rings of one piece.
void add_elements(SurfaceElements& out, const ProfilePiece& piece, double size, double turn) {
  const double length = length_of(piece);
  const int rings = std::max(1, static_cast<int>(std::ceil(length / size - 1e-9)));
  const double dl = length / rings;
  const auto quarter_of_a_ring = [&](const ProfilePoint& p) {
    return std::max(2, static_cast<int>(std::ceil(0.5 * kPi * p.r / size - 1e-9)));
  };
  std::size_t count = out.size();
  for (int i = 0; i < rings; ++i)
    count += 4u * static_cast<std::size_t>(quarter_of_a_ring(point_on(piece, (i + 0.5) / rings)));
  if (count > 20'000'000u)
    throw Error("bur elements: a size of " + std::to_string(size) +
                " mm gives more than 20 million elements; choose a larger one");
  for (int i = 0; i < rings; ++i) {
    const ProfilePoint p = point_on(piece, (i + 0.5) / rings);
    const int quarter = quarter_of_a_ring(p);
    const double dphi = 0.5 * kPi / quarter;
    const double area = swept_area(piece, double(i) / rings, (i + 1.0) / rings) / (4.0 * quarter);
    // Rings are turned against each other by the golden ratio of their spacing: a plane that the
    // bur meets then switches elements on one by one instead of a whole column at once. Counted
    // from the piece's middle, so that the two halves of a ball mirror each other and their axial
    // forces cancel.
    const int from_middle = std::abs(2 * i - (rings - 1)) / 2;  // in rings
    const double turns = kGoldenRatio * from_middle;
    const double phase = turns - std::floor(turns);
    const double around = p.r > 0 ? p.along_z / p.r : 0;
    const double along = piece.kind == ProfilePiece::Kind::kArc
                             ? (piece.convex ? 1 : -1) /
                                   std::hypot(piece.r0 - piece.centre_r, piece.z0 - piece.centre_z)
                             : 0;
    for (int side = 0; side < 4; ++side) {
      for (int j = 0; j < quarter; ++j) {
        // cos and sin of the first quarter only, turned by exact right angles.
        const double phi = (j + phase) * dphi, c0 = std::cos(phi), s0 = std::sin(phi);
        const double c = side == 0 ? c0 : side == 1 ? -s0 : side == 2 ? -c0 : s0;
        const double s = side == 0 ? s0 : side == 1 ? c0 : side == 2 ? -s0 : -c0;
        const auto put = [](std::vector<float>& v, double value) {
          v.push_back(static_cast<float>(value));
        };
        put(out.x, p.r * c);
        put(out.y, p.r * s);
        put(out.z, p.z);
        put(out.nx, p.along_z * c);
        put(out.ny, p.along_z * s);
        put(out.nz, -p.along_r);
        put(out.tx, -turn * s);
        put(out.ty, turn * c);
        put(out.lx, p.along_r * c);
        put(out.ly, p.along_r * s);
        put(out.lz, p.along_z);
        put(out.weight, dphi * dl);
        put(out.area, area);
        put(out.radius, p.r);
        put(out.half_along, 0.5 * dl);
        put(out.half_around, 0.5 * p.r * dphi);
        put(out.curvature_along, along);
        put(out.curvature_around, around);
      }
    }
  }
}

}  // namespace

DistanceOutline<float> fast_outline(const std::vector<ProfilePiece>& head) {
  DistanceOutline<double> outline = outline_of(head);
  for (const SharpEdge& e : sharp_edges(head))
    outline.corners.push_back({e.after.r, e.after.z, e.before.along_r, e.before.along_z,
                               e.after.along_r, e.after.along_z});
  return in_float(outline);
}

Bur::Bur(std::string name, std::vector<ProfilePiece> head, double shank_radius, double shank_top)
    : name_(std::move(name)),
      head_(checked_outline(std::move(head))),
      shank_radius_(shank_radius),
      shank_top_(shank_top) {
  bool any = false;
  for (const ProfilePiece& piece : head_) {
    const ProfileBounds box = bounds_of(piece);
    head_length_ = std::max(head_length_, box.z_max);
    max_radius_ = std::max(max_radius_, box.r_max);
    any = any || piece.grinds;
  }
  if (max_radius_ < 0.02)
    throw Error("bur profile: the largest radius is " + std::to_string(max_radius_) +
                " mm, below 0.02 mm; are the coordinates in mm?");
  if (!any) throw Error("bur profile: no piece grinds");
  if (!(shank_radius >= 0 && shank_radius <= 10))
    throw Error("bur shank: the radius must be within 0 .. 10 mm, got " +
                std::to_string(shank_radius));
  if (shank_radius > 0 && !(shank_top > head_length_ && shank_top <= 50))
    throw Error("bur shank: its top must lie above the head (" + std::to_string(head_length_) +
                " mm) and not above 50 mm, got " + std::to_string(shank_top));
  if (shank_radius == 0) shank_top_ = head_length_;
  exact_ = outline_of(head_);
  fast_ = fast_outline(head_);
}

double Bur::head_volume() const {
  double volume = 0;
  for (const ProfilePiece& piece : head_) volume += swept_volume(piece);
  return volume;
}

double Bur::grinding_area() const {
  double area = 0;
  for (const ProfilePiece& piece : head_)
    if (piece.grinds) area += swept_area(piece);
  return area;
}

SurfaceElements Bur::elements(double size, bool clockwise) const {
  check_size(size);
  SurfaceElements out;
  for (const ProfilePiece& piece : head_)
    if (piece.grinds) add_elements(out, piece, size, clockwise ? 1 : -1);
  return out;
}

SurfaceElements Bur::shank_elements(double size) const {
  check_size(size);
  SurfaceElements out;
  if (shank_radius_ > 0)
    add_elements(out, line_piece(shank_radius_, head_length_, shank_radius_, shank_top_), size, 1);
  return out;
}

}  // namespace toothprep
