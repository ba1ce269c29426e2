#include "toothprep/proof/reference/profile_breaks.h"

#include <Eigen/LU>
#include <algorithm>
#include <boost/math/tools/toms748_solve.hpp>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "toothprep/step/core/units.h"

namespace toothprep::reference {
namespace {

using units::kPi;

constexpr double kTiny = 1e-12;      // a direction's part below this is none
constexpr double kMerge = 1e-13;     // breaks closer than this are one
constexpr int kBracketSamples = 24;  // for roots without a closed form

class Breaks {
 public:
  explicit Breaks(const ProfilePiece& piece) : piece_(piece) {
    if (piece.kind == ProfilePiece::Kind::kArc) span_ = arc_span(piece);
  }

  bool is_arc() const { return piece_.kind == ProfilePiece::Kind::kArc; }

  void add(double s) {
    if (s > 0 && s < 1) at_.push_back(s);
  }

  // Arcs: the angle about the arc's centre.
  void add_angle(double beta) {
    const double period = 2 * kPi / std::abs(span_.sweep);
    const double s = (beta - span_.start) / span_.sweep;
    add(s - period * std::floor(s / period));
  }

  // The points with p r + q z = c.
  void add_line(double p, double q, double c) {
    if (is_arc()) {
      const double size = span_.radius * std::hypot(p, q);
      const double rest = c - p * piece_.centre_r - q * piece_.centre_z;
      if (size == 0 || std::abs(rest) > size) return;
      const double middle = std::atan2(q, p), half = std::acos(rest / size);
      add_angle(middle - half);
      add_angle(middle + half);
    } else {
      const double slope = p * (piece_.r1 - piece_.r0) + q * (piece_.z1 - piece_.z0);
      if (slope != 0) add((c - p * piece_.r0 - q * piece_.z0) / slope);
    }
  }

  // Roots of f within (from, to) that change its sign between samples.
  template <class F>
  void add_roots(const F& f, double from, double to) {
    double s0 = from, f0 = f(from);
    for (int i = 1; i <= kBracketSamples; ++i) {
      const double s1 = from + (to - from) * i / kBracketSamples, f1 = f(s1);
      if (f0 * f1 < 0) {
        std::uintmax_t calls = 60;
        const auto root = boost::math::tools::toms748_solve(
            f, s0, s1, f0, f1, boost::math::tools::eps_tolerance<double>(50), calls);
        add((root.first + root.second) / 2);
      } else if (f1 == 0) {
        add(s1);
      }
      s0 = s1;
      f0 = f1;
    }
  }

  std::vector<double> sorted() const {
    std::vector<double> all = at_;
    all.push_back(0);
    all.push_back(1);
    std::sort(all.begin(), all.end());
    std::vector<double> out;
    for (const double s : all)
      if (out.empty() || s - out.back() > kMerge) out.push_back(s);
    out.back() = 1;
    return out;
  }

 private:
  const ProfilePiece& piece_;
  ArcSpan span_{};
  std::vector<double> at_;
};

// Where the line in which two planes meet pierces the surface.
void add_edge(Breaks& breaks, const ProfilePiece& piece, const HalfSpace& i, const HalfSpace& j) {
  Vec3 e = i.a.cross(j.a);
  if (e.norm() < 1e-9) return;  // parallel
  e.normalize();
  Mat3 rows;
  rows << i.a.transpose(), j.a.transpose(), e.transpose();
  const Vec3 q = rows.partialPivLu().solve(Vec3(i.d, j.d, 0));
  if (e.head<2>().norm() < kTiny) {
    breaks.add_line(1, 0, q.head<2>().norm());
  } else if (std::abs(e.z()) < kTiny) {
    breaks.add_line(0, 1, q.z());
  } else {
    const auto miss = [&](double s) {
      const ProfilePoint p = point_on(piece, s);
      const double t = (p.z - q.z()) / e.z();
      return p.r * p.r - (q.head<2>() + t * e.head<2>()).squaredNorm();
    };
    breaks.add_roots(miss, 0, 1);
  }
}

// Where the silhouette begins, ends and crosses planes. On the silhouette
// cos(phi - phi_v) = -n_z v_z / (n_r |v_h|).
void add_silhouette(Breaks& breaks, const ProfilePiece& piece, const std::vector<HalfSpace>& planes,
                    const Vec3& feed) {
  const double along = feed.z(), across = feed.head<2>().norm();
  if (across <= kTiny * feed.norm()) {  // the silhouette is where r is extreme
    if (breaks.is_arc())
      for (const double beta : {0.0, kPi}) breaks.add_angle(beta);
    return;
  }
  const double phi_v = std::atan2(feed.y(), feed.x());
  const bool level = std::abs(along) <= kTiny * feed.norm();

  if (breaks.is_arc() && !level) {
    const double beta = std::atan2(across, std::abs(along));
    for (const double b : {beta, -beta, kPi - beta, kPi + beta}) breaks.add_angle(b);
  }
  const std::vector<double> parts =
      breaks.is_arc() && !level ? breaks.sorted() : std::vector{0.0, 1.0};
  const auto cosine = [&](const ProfilePoint& p) {
    return level ? 0.0 : p.along_r * along / (p.along_z * across);  // n = (along_z, -along_r)
  };
  for (const HalfSpace& h : planes) {
    if (h.across == 0) continue;  // a plane z = const: a break already
    for (const double side : {-1.0, 1.0}) {
      if (!breaks.is_arc() || level) {
        const double c = cosine(point_on(piece, 0.5));
        if (!(std::abs(c) < 1)) continue;
        const double angle = phi_v + side * std::acos(c);
        breaks.add_line(h.across * std::cos(angle - h.phi), h.a.z(), h.d);
        continue;
      }
      const auto miss = [&](double s) {
        const ProfilePoint p = point_on(piece, s);
        const double angle = phi_v + side * std::acos(std::clamp(cosine(p), -1.0, 1.0));
        return h.across * p.r * std::cos(angle - h.phi) + h.a.z() * p.z - h.d;
      };
      for (std::size_t i = 0; i + 1 < parts.size(); ++i)
        if (std::abs(cosine(point_on(piece, (parts[i] + parts[i + 1]) / 2))) < 1)
          breaks.add_roots(miss, parts[i], parts[i + 1]);
    }
  }
}

}  // namespace

HalfSpace::HalfSpace(const Vec3& normal, double offset) : a(normal), d(offset) {
  across = a.head<2>().norm();
  if (across < kTiny) across = 0;
  phi = across > 0 ? std::atan2(a.y(), a.x()) : 0;
}

std::vector<double> contact_breaks(const ProfilePiece& piece, const std::vector<HalfSpace>& planes,
                                   const Vec3& feed) {
  Breaks breaks(piece);
  for (std::size_t i = 0; i < planes.size(); ++i) {
    breaks.add_line(planes[i].across, planes[i].a.z(), planes[i].d);
    if (planes[i].across > 0) breaks.add_line(-planes[i].across, planes[i].a.z(), planes[i].d);
    for (std::size_t j = 0; j < i; ++j) add_edge(breaks, piece, planes[i], planes[j]);
  }
  add_silhouette(breaks, piece, planes, feed);
  return breaks.sorted();
}

}  // namespace toothprep::reference
