#include "toothprep/step/bur/profile.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <sstream>
#include <string>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

using units::kPi;
using Kind = ProfilePiece::Kind;

constexpr double kJoint = 1e-6;        // mm: ends closer than this are one joint
constexpr double kCentreSlack = 1e-3;  // mm: room for centres written with three decimals
constexpr double kMaxRadius = 10.0;    // mm
constexpr double kMaxLength = 50.0;    // mm
constexpr std::size_t kMaxPieces = 1000;

bool sweeps_over(const ArcSpan& span, double angle) {
  double turn = span.sweep > 0 ? angle - span.start : span.start - angle;
  turn -= 2 * kPi * std::floor(turn / (2 * kPi));
  return turn <= std::abs(span.sweep);
}

[[noreturn]] void refuse(std::size_t i, const std::string& condition) {
  throw Error("bur profile: piece " + std::to_string(i + 1) + ": " + condition);
}

std::string text(double a) { return fmt::format("{:g}", a); }
std::string text(double r, double z) { return fmt::format("({:g}, {:g})", r, z); }

struct Point {
  double r, z;
};
double gap(Point a, Point b) { return std::hypot(a.r - b.r, a.z - b.z); }

// Is p, known to lie on the piece's line or circle, between the piece's ends (give or take kJoint)?
bool between_ends(const ProfilePiece& piece, Point p) {
  if (gap(p, {piece.r0, piece.z0}) < kJoint || gap(p, {piece.r1, piece.z1}) < kJoint) return true;
  if (piece.kind == Kind::kLine) {
    const double ur = piece.r1 - piece.r0, uz = piece.z1 - piece.z0;
    const double t = ((p.r - piece.r0) * ur + (p.z - piece.z0) * uz) / (ur * ur + uz * uz);
    return t >= 0 && t <= 1;
  }
  return sweeps_over(arc_span(piece), std::atan2(p.z - piece.centre_z, p.r - piece.centre_r));
}

// Points common to the lines or circles that carry two pieces; for coincident carriers the pieces'
// ends.
std::vector<Point> carrier_meets(const ProfilePiece& a, const ProfilePiece& b) {
  const std::vector<Point> ends = {{a.r0, a.z0}, {a.r1, a.z1}, {b.r0, b.z0}, {b.r1, b.z1}};
  if (a.kind == Kind::kLine && b.kind == Kind::kLine) {
    const double ar = a.r1 - a.r0, az = a.z1 - a.z0, br = b.r1 - b.r0, bz = b.z1 - b.z0;
    const double cross = ar * bz - az * br, la = std::hypot(ar, az), lb = std::hypot(br, bz);
    const double off = ((b.r0 - a.r0) * az - (b.z0 - a.z0) * ar) / la;
    if (std::abs(cross) < 1e-12 * la * lb)
      return std::abs(off) < kJoint ? ends : std::vector<Point>{};
    const double t = ((b.r0 - a.r0) * bz - (b.z0 - a.z0) * br) / cross;
    return {{a.r0 + t * ar, a.z0 + t * az}};
  }
  if (a.kind == Kind::kArc && b.kind == Kind::kLine) return carrier_meets(b, a);
  const double radius = arc_span(b).radius;
  if (a.kind == Kind::kLine) {
    const double length = length_of(a), ur = (a.r1 - a.r0) / length, uz = (a.z1 - a.z0) / length;
    const double foot = (b.centre_r - a.r0) * ur + (b.centre_z - a.z0) * uz;
    const double off = (b.centre_r - a.r0) * uz - (b.centre_z - a.z0) * ur;
    if (std::abs(off) > radius) return {};
    const double half = std::sqrt(radius * radius - off * off);
    return {{a.r0 + (foot - half) * ur, a.z0 + (foot - half) * uz},
            {a.r0 + (foot + half) * ur, a.z0 + (foot + half) * uz}};
  }
  const double radius_a = arc_span(a).radius;
  const double dr = b.centre_r - a.centre_r, dz = b.centre_z - a.centre_z, d = std::hypot(dr, dz);
  if (d < kJoint) return std::abs(radius_a - radius) < kJoint ? ends : std::vector<Point>{};
  const double foot = (d * d + radius_a * radius_a - radius * radius) / (2 * d);
  if (std::abs(foot) > radius_a) return {};
  const double half = std::sqrt(radius_a * radius_a - foot * foot), ur = dr / d, uz = dz / d;
  return {{a.centre_r + foot * ur - half * uz, a.centre_z + foot * uz + half * ur},
          {a.centre_r + foot * ur + half * uz, a.centre_z + foot * uz - half * ur}};
}

// A point where two pieces meet other than the joint that successive pieces share.
std::optional<Point> crossing(const ProfilePiece& a, const ProfilePiece& b, bool successive) {
  for (const Point p : carrier_meets(a, b)) {
    // Where pieces join smoothly the common point is a double root, good to sqrt(eps) only.
    if (successive && gap(p, {a.r1, a.z1}) < 1e-5) continue;
    if (between_ends(a, p) && between_ends(b, p)) return p;
  }
  return std::nullopt;
}

void put_centre_on_bisector(ProfilePiece& arc, std::size_t i) {
  const double cr = arc.r1 - arc.r0, cz = arc.z1 - arc.z0, chord = std::hypot(cr, cz);
  const double mr = 0.5 * (arc.r0 + arc.r1), mz = 0.5 * (arc.z0 + arc.z1);
  const double off = ((arc.centre_r - mr) * cr + (arc.centre_z - mz) * cz) / chord;
  if (std::abs(off) > kCentreSlack)
    refuse(i, "the arc's centre " + text(arc.centre_r, arc.centre_z) +
                  " is not equally far from its two ends");
  arc.centre_r -= off * cr / chord;
  arc.centre_z -= off * cz / chord;
}

}  // namespace

ProfilePiece line_piece(double r0, double z0, double r1, double z1, bool grinds) {
  return {Kind::kLine, r0, z0, r1, z1, 0, 0, true, grinds};
}

ProfilePiece arc_piece(double r0, double z0, double r1, double z1, double centre_r, double centre_z,
                       bool convex, bool grinds) {
  return {Kind::kArc, r0, z0, r1, z1, centre_r, centre_z, convex, grinds};
}

ArcSpan arc_span(const ProfilePiece& arc) {
  const double start = std::atan2(arc.z0 - arc.centre_z, arc.r0 - arc.centre_r);
  const double end = std::atan2(arc.z1 - arc.centre_z, arc.r1 - arc.centre_r);
  double sweep = end - start;
  if (arc.convex && sweep <= 0) sweep += 2 * kPi;
  if (!arc.convex && sweep >= 0) sweep -= 2 * kPi;
  return {std::hypot(arc.r0 - arc.centre_r, arc.z0 - arc.centre_z), start, sweep};
}

ProfilePoint point_on(const ProfilePiece& piece, double fraction) {
  if (piece.kind == Kind::kLine) {
    const double length = length_of(piece);
    return {piece.r0 + fraction * (piece.r1 - piece.r0),
            piece.z0 + fraction * (piece.z1 - piece.z0), (piece.r1 - piece.r0) / length,
            (piece.z1 - piece.z0) / length};
  }
  const ArcSpan span = arc_span(piece);
  const double angle = span.start + fraction * span.sweep, turn = piece.convex ? 1 : -1;
  return {piece.centre_r + span.radius * std::cos(angle),
          piece.centre_z + span.radius * std::sin(angle), -turn * std::sin(angle),
          turn * std::cos(angle)};
}

bool is_convex(const std::vector<ProfilePiece>& outline) {
  constexpr double kLevel = 1e-9;
  double before_r = 1, before_z = 0;  // along the tip's mirror image at its flattest
  for (const ProfilePiece& piece : outline) {
    if (piece.kind == Kind::kArc && !piece.convex) return false;
    const ProfilePoint from = point_on(piece, 0), to = point_on(piece, 1);
    if (before_r * from.along_z - before_z * from.along_r < -kLevel) return false;
    before_r = to.along_r;
    before_z = to.along_z;
  }
  return before_z >= -kLevel;
}

std::vector<SharpEdge> sharp_edges(const std::vector<ProfilePiece>& outline, double least_sine) {
  std::vector<SharpEdge> edges;
  for (std::size_t i = 1; i < outline.size(); ++i) {
    if (!outline[i - 1].grinds || !outline[i].grinds) continue;
    const ProfilePoint a = point_on(outline[i - 1], 1), b = point_on(outline[i], 0);
    if (a.along_r * b.along_z - a.along_z * b.along_r > least_sine) edges.push_back({a, b});
  }
  return edges;
}

ProfileBounds bounds_of(const ProfilePiece& piece) {
  ProfileBounds box = {std::min(piece.r0, piece.r1), std::max(piece.r0, piece.r1),
                       std::min(piece.z0, piece.z1), std::max(piece.z0, piece.z1)};
  if (piece.kind == Kind::kArc) {
    const ArcSpan span = arc_span(piece);
    if (sweeps_over(span, 0)) box.r_max = piece.centre_r + span.radius;
    if (sweeps_over(span, kPi)) box.r_min = piece.centre_r - span.radius;
    if (sweeps_over(span, kPi / 2)) box.z_max = piece.centre_z + span.radius;
    if (sweeps_over(span, -kPi / 2)) box.z_min = piece.centre_z - span.radius;
  }
  return box;
}

double length_of(const ProfilePiece& piece) {
  if (piece.kind == Kind::kLine) return std::hypot(piece.r1 - piece.r0, piece.z1 - piece.z0);
  const ArcSpan span = arc_span(piece);
  return span.radius * std::abs(span.sweep);
}

double swept_area(const ProfilePiece& piece, double from, double to) {
  if (piece.kind == Kind::kLine) {
    const double r_mid = piece.r0 + 0.5 * (from + to) * (piece.r1 - piece.r0);
    return 2 * kPi * r_mid * (to - from) * length_of(piece);
  }
  // r = centre_r + rho cos(a), dl = rho |da|.
  const ArcSpan span = arc_span(piece);
  const double a = span.start + from * span.sweep, b = span.start + to * span.sweep;
  const double signed_area =
      span.radius * (piece.centre_r * (b - a) + span.radius * (std::sin(b) - std::sin(a)));
  return 2 * kPi * (piece.convex ? signed_area : -signed_area);
}

double swept_volume(const ProfilePiece& piece) {
  const double dz = piece.z1 - piece.z0;
  if (piece.kind == Kind::kLine)
    return kPi * dz * (piece.r0 * piece.r0 + piece.r0 * piece.r1 + piece.r1 * piece.r1) / 3;
  // pi integral of (c + rho cos a)^2 rho cos a da.
  const ArcSpan span = arc_span(piece);
  const double c = piece.centre_r, rho = span.radius;
  const auto primitive = [&](double a) {
    const double s = std::sin(a);
    return c * c * rho * s + c * rho * rho * (a + s * std::cos(a)) +
           rho * rho * rho * (s - s * s * s / 3);
  };
  return kPi * (primitive(span.start + span.sweep) - primitive(span.start));
}

double enclosed_area(const ProfilePiece& piece) {
  if (piece.kind == Kind::kLine) return 0.5 * (piece.r0 + piece.r1) * (piece.z1 - piece.z0);
  const ArcSpan span = arc_span(piece);
  const double c = piece.centre_r, rho = span.radius;
  const auto primitive = [&](double a) {
    return c * rho * std::sin(a) + 0.5 * rho * rho * (a + std::sin(a) * std::cos(a));
  };
  return primitive(span.start + span.sweep) - primitive(span.start);
}

std::string outline_text(const std::vector<ProfilePiece>& outline) {
  std::string all;
  for (const ProfilePiece& p : outline) {
    if (!all.empty()) all += "; ";
    const bool is_line = p.kind == Kind::kLine;
    all += fmt::format("{} {} {} {} {}", is_line ? "line" : "arc", p.r0, p.z0, p.r1, p.z1);
    if (!is_line)
      all += fmt::format(" {} {} {}", p.centre_r, p.centre_z, p.convex ? "convex" : "concave");
  }
  return all;
}

std::vector<ProfilePiece> outline_of(const std::string& text) {
  std::vector<ProfilePiece> outline;
  std::istringstream all(text);
  for (std::string piece; std::getline(all, piece, ';');) {
    std::istringstream in(piece);
    std::string kind, turn, more;
    ProfilePiece& p = outline.emplace_back();
    in >> kind >> p.r0 >> p.z0 >> p.r1 >> p.z1;
    const bool is_arc = kind == "arc";
    if (is_arc) {
      p.kind = Kind::kArc;
      in >> p.centre_r >> p.centre_z >> turn;
      p.convex = turn == "convex";
    }
    const bool is_known = is_arc ? p.convex || turn == "concave" : kind == "line";
    if (!in || !is_known || in >> more)
      throw Error("bur profile: \"" + piece + "\" is no piece of an outline");
  }
  return outline;
}

std::vector<ProfilePiece> checked_outline(std::vector<ProfilePiece> pieces) {
  if (pieces.empty()) throw Error("bur profile: has no pieces");
  if (pieces.size() > kMaxPieces)
    throw Error("bur profile: " + std::to_string(pieces.size()) + " pieces, more than " +
                std::to_string(kMaxPieces));
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    ProfilePiece& p = pieces[i];
    const bool arc = p.kind == Kind::kArc;
    for (const double value : {p.r0, p.z0, p.r1, p.z1, arc ? p.centre_r : 0, arc ? p.centre_z : 0})
      if (!std::isfinite(value) || std::abs(value) > 1e4)
        refuse(i, "a coordinate is not finite or beyond 10 m");
    const Point expected = i == 0 ? Point{0, 0} : Point{pieces[i - 1].r1, pieces[i - 1].z1};
    const double miss = gap(expected, {p.r0, p.z0});
    if (miss > kJoint && i == 0)
      refuse(i, "starts at " + text(p.r0, p.z0) + ", but the profile must start at the tip (0, 0)");
    if (miss > kJoint)
      refuse(i, "starts at " + text(p.r0, p.z0) + ", a gap of " + text(miss) +
                    " mm from the end of the piece before at " + text(expected.r, expected.z));
    p.r0 = expected.r;
    p.z0 = expected.z;
    if (std::abs(p.r1) < kJoint && i + 1 == pieces.size()) p.r1 = 0;
    if (gap({p.r0, p.z0}, {p.r1, p.z1}) < kJoint) refuse(i, "has no length");
    if (arc) put_centre_on_bisector(p, i);

    const ProfileBounds box = bounds_of(p);
    if (box.r_min < -kJoint)
      refuse(i, "reaches r = " + text(box.r_min) + " mm, but r must not be negative");
    if (box.z_min < -kJoint)
      refuse(i, "reaches z = " + text(box.z_min) +
                    " mm, but the tip at z = 0 must be the lowest point");
    if (box.r_max > kMaxRadius)
      refuse(i, "reaches r = " + text(box.r_max) + " mm, above the limit of 10 mm");
    if (box.z_max > kMaxLength)
      refuse(i, "reaches z = " + text(box.z_max) + " mm, above the limit of 50 mm");
    const bool last = i + 1 == pieces.size();
    if (last && p.r1 != 0)
      refuse(i, "ends at " + text(p.r1, p.z1) + ", but the profile must end on the axis (r = 0)");
    if (!last && p.r1 < kJoint) refuse(i, "ends on the axis, but only the last piece may");
  }
  for (std::size_t i = 1; i < pieces.size(); ++i) {
    const ProfilePoint before = point_on(pieces[i - 1], 1), after = point_on(pieces[i], 0);
    if (before.along_r * after.along_r + before.along_z * after.along_z < -1 + 1e-9)
      refuse(i, "folds back on the piece before");
  }
  for (std::size_t i = 0; i < pieces.size(); ++i)
    for (std::size_t j = i + 1; j < pieces.size(); ++j)
      if (const auto p = crossing(pieces[i], pieces[j], j == i + 1))
        refuse(j, "crosses or touches piece " + std::to_string(i + 1) + " at " + text(p->r, p->z));
  // An outline that rises from (0, 0), the lowest point, to the axis above without crossing itself
  // has the solid on its left: there is no other way round.
  double area = 0;
  for (const ProfilePiece& p : pieces) area += enclosed_area(p);
  if (area < 1e-9) throw Error("bur profile: encloses no area");
  return pieces;
}

}  // namespace toothprep
