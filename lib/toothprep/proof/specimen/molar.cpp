#include "toothprep/proof/specimen/molar.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <span>
#include <string>
#include <unsupported/Eigen/AutoDiff>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

// The shape. Inside this file u is buccal (+) to lingual, v distal (+) to mesial, both from the
// long axis, z as in W, all mm. Crown 10.5 x 10.5 mm, 7.8 mm high; an average lower first molar by
// its crown, with roots at the short end of the range so that all coordinates are positive.
//
// Every surface is an implicit function, negative inside, carried with its exact gradient (forward
// differentiation) and divided by the gradient's length at the very end: so the parts can be
// blended freely and the result is still a distance near its zero set.
namespace toothprep {
namespace {

using Jet = Eigen::AutoDiffScalar<Vec3>;  // a value and its gradient in (x, y, z)

constexpr double kAxisX = 6.1, kAxisY = 5.5;
const Vec3 kCrown(kAxisX, kAxisY, 14);  // the middle of the crown, about which it leans
constexpr double kHighestTip = 19.1;    // mm
constexpr double kMostWorn = 4;         // mm
constexpr double kBelowNeck = 10.6;     // mm: where the roots of a rootless one are cut off
constexpr double kPremolarWidth = 0.8, kPremolarLength = 0.67;  // of the molar's
constexpr double kFossa = 16.75;  // height of the occlusal basin before grooves are cut, mm

// ---- Jets ----------------------------------------

// g(a) for a function with this value and slope at a.
Jet chain(const Jet& a, double value, double slope) { return Jet(value, slope * a.derivatives()); }
Jet square(const Jet& a) { return chain(a, a.value() * a.value(), 2 * a.value()); }
Jet root(const Jet& a) {
  const double r = std::sqrt(a.value());
  return chain(a, r, 0.5 / r);
}
Jet bell(const Jet& a) {  // exp(-a²)
  const double e = std::exp(-a.value() * a.value());
  return chain(a, e, -2 * a.value() * e);
}
// 0 below `low`, 1 above `high`, smooth between.
Jet step(const Jet& a, double low, double high) {
  const double t = std::clamp((a.value() - low) / (high - low), 0.0, 1.0);
  return chain(a, t * t * (3 - 2 * t), 6 * t * (1 - t) / (high - low));
}
// a limited to 0..1, with rounded corners.
Jet soft_clamp(const Jet& a) {
  constexpr double kCorner = 0.25;
  const double t = a.value();
  const auto corner = [](double x) {  // max(x, 0) rounded over |x| < kCorner
    return x <= -kCorner ? 0.0 : x >= kCorner ? x : (x + kCorner) * (x + kCorner) / (4 * kCorner);
  };
  const auto slope = [](double x) { return std::clamp((x + kCorner) / (2 * kCorner), 0.0, 1.0); };
  return chain(a, corner(t) - corner(t - 1), slope(t) - slope(t - 1));
}
Jet power(const Jet& a, double exponent) {  // |a|^exponent, exponent > 1
  const double m = std::abs(a.value());
  const double p = std::pow(m, exponent - 1);
  return chain(a, p * m, std::copysign(exponent * p, a.value()));
}

// Minimum and maximum with a fillet: they differ from the plain ones where |a - b| < k, by k/6 at
// most.
Jet smooth_min(const Jet& a, const Jet& b, double k) {
  const double h = 1 - std::abs(a.value() - b.value()) / k;
  const bool first = a.value() < b.value();
  const Jet& least = first ? a : b;
  if (h <= 0) return least;
  const double w = h * h / 2;  // weight of the other one's gradient
  const Vec3& g = least.derivatives();
  return Jet(least.value() - h * h * h * k / 6, g + w * ((first ? b : a).derivatives() - g));
}
Jet smooth_max(const Jet& a, const Jet& b, double k) { return -smooth_min(Jet(-a), Jet(-b), k); }

// Uniform cubic B-spline with the given control values, the first at z0, dz apart; constant
// outside.
template <std::size_t N>
Jet spline(const std::array<double, N>& control, double z0, double dz, const Jet& z) {
  const double s = std::clamp((z.value() - z0) / dz, 0.0, N - 1.0);
  const int i = std::min(static_cast<int>(s), static_cast<int>(N) - 2);
  const double t = s - i;
  const auto at = [&](int k) { return control[std::clamp(k, 0, static_cast<int>(N) - 1)]; };
  const double p = at(i - 1), q = at(i), r = at(i + 1), w = at(i + 2);
  const double value = (p * (1 - t) * (1 - t) * (1 - t) + q * (3 * t * t * t - 6 * t * t + 4) +
                        r * (-3 * t * t * t + 3 * t * t + 3 * t + 1) + w * t * t * t) /
                       6;
  const double slope = (-p * (1 - t) * (1 - t) + q * (3 * t * t - 4 * t) +
                        r * (-3 * t * t + 2 * t + 1) + w * t * t) /
                       2 / dz;
  const bool outside = z.value() < z0 || z.value() > z0 + dz * (N - 1);
  return chain(z, value, outside ? 0.0 : slope);
}

struct Point {
  Jet u, v, z;
};

// ---- Axial walls ----------------------------------------

// Height above the cemento-enamel junction, which rises towards the neighbours, more on the mesial
// side.
Jet above_cej(const Point& p) {
  return p.z - 11.4 - square(p.v) * (p.v.value() < 0 ? 0.045 : 0.03);
}

// Half extents of crown and root trunk by height, at z = 8, 9.5, ... 20: buccal with its bulge in
// the cervical third and leaning inwards above, lingual upright, the contact areas high on the
// sides.
constexpr double kFirstHeight = 8, kHeightStep = 1.5;
constexpr std::array<double, 9> kBuccal = {3.4, 3.95, 4.55, 5.1, 5.2, 4.85, 4.3, 3.55, 2.7};
constexpr std::array<double, 9> kLingual = {3.3, 3.85, 4.35, 4.75, 5.0, 5.1, 4.95, 4.5, 3.8};
constexpr std::array<double, 9> kMesial = {3.6, 4.1, 4.5, 4.9, 5.2, 5.35, 5.25, 4.8, 4.0};
constexpr std::array<double, 9> kDistal = {3.5, 4.0, 4.4, 4.8, 5.1, 5.2, 5.0, 4.5, 3.7};

// Distance-like function of the side walls: distance from the axis minus the outline's in that
// direction. The outline is a superellipse with one half axis per side, narrower distally.
Jet side_walls(const Point& p) {
  const Jet b = p.u.value() > 0 ? spline(kBuccal, kFirstHeight, kHeightStep, p.z)
                                : spline(kLingual, kFirstHeight, kHeightStep, p.z);
  const Jet a = p.v.value() > 0 ? spline(kDistal, kFirstHeight, kHeightStep, p.z)
                                : spline(kMesial, kFirstHeight, kHeightStep, p.z);
  constexpr double kExponent = 2.6;
  const Jet narrowed = p.u * (1.0 + (p.u.value() > 0 ? 0.034 : 0.022) * p.v);
  const Jet sum = power(narrowed / b, kExponent) + power(p.v / a, kExponent) + 1e-9;
  const double g = std::pow(sum.value(), 1 / kExponent);
  const Jet gauge = chain(sum, g, g / (kExponent * sum.value()));
  const Jet distance = root(square(p.u) + square(p.v) + 1e-6);
  return distance - distance / gauge;
}

// Depth of the furrows in which the buccal and lingual grooves run down the walls.
Jet furrows(const Point& p) {
  const double side = std::abs(p.u.value());
  if (side < 2.0 || p.z.value() < 12.5) return Jet(0.0);
  const Jet height = step(p.z, 12.5, 17.5);
  if (p.u.value() > 0)
    return height * step(p.u, 2.0, 3.5) *
           (0.45 * bell((p.v + 1.0) / 0.75) + 0.40 * bell((p.v - 2.35) / 0.65));
  return height * step(Jet(-p.u), 2.0, 3.5) * (0.35 * bell((p.v - 0.15) / 0.8));
}

// ---- Occlusal surface ----------------------------------------

// A ridge with a crest from (u0, v0, z0) to (u1, v1, z1), lower by `sag` in its middle, falling off
// to all sides.
struct Ridge {
  double u0, v0, z0, u1, v1, z1, slope, sag;
};

Jet ridge_height(const Point& p, const Ridge& r, double roundness) {
  const double du = r.u1 - r.u0, dv = r.v1 - r.v0, length2 = du * du + dv * dv;
  const Jet t = soft_clamp(((p.u - r.u0) * du + (p.v - r.v0) * dv) / length2);
  const Jet across =
      root(square(p.u - r.u0 - t * du) + square(p.v - r.v0 - t * dv) + roundness * roundness);
  return r.z0 + (r.z1 - r.z0) * t - 4 * r.sag * t * (1.0 - t) - r.slope * (across - roundness);
}

// A cusp is its triangular ridge, from the tip to the middle of the crown, and its cuspal ridge
// along the rim; a marginal ridge is one alone. Heights above kFossa.
struct Lobe {
  Ridge triangular, cuspal;
  bool cusp;
};
constexpr std::array<Lobe, 7> kLobes = {{
    // mesiobuccal
    {{2.75, -2.55, 2.20, 0.70, -1.75, 0.70, 0.95, 0.0},
     {2.45, -3.80, 1.60, 2.75, -1.60, 1.75, 0.95, -0.15},
     true},
    // distobuccal
    {{2.90, 0.75, 2.05, 0.65, 0.55, 0.60, 0.95, 0.0},
     {2.90, -0.25, 1.60, 2.75, 1.70, 1.55, 0.95, -0.15},
     true},
    // distal
    {{2.05, 3.25, 1.60, 0.65, 2.45, 0.50, 0.95, 0.0},
     {2.40, 2.70, 1.30, 1.20, 3.95, 1.10, 0.95, -0.12},
     true},
    // mesiolingual
    {{-3.05, -2.30, 2.55, -0.70, -1.50, 0.70, 1.0, 0.0},
     {-2.60, -3.60, 1.80, -3.20, -0.90, 1.90, 1.0, -0.15},
     true},
    // distolingual
    {{-2.90, 2.15, 2.40, -0.75, 1.45, 0.65, 1.0, 0.0},
     {-3.15, 0.90, 1.75, -2.30, 3.30, 1.70, 1.0, -0.15},
     true},
    // mesial and distal marginal ridges
    {{2.10, -4.10, 1.55, -2.10, -4.15, 1.60, 0.95, 0.30}, {}, false},
    {{1.20, 4.20, 1.15, -1.90, 4.05, 1.30, 0.95, 0.22}, {}, false},
}};

// Of a premolar: one cusp each to buccal and lingual.
constexpr std::array<Lobe, 4> kPremolarLobes = {{
    {{2.85, 0.0, 2.45, 0.70, 0.0, 0.70, 0.95, 0.0},
     {2.75, -2.9, 1.30, 2.75, 2.9, 1.30, 0.95, -0.85},
     true},
    {{-3.0, 0.0, 2.0, -0.70, 0.0, 0.65, 1.0, 0.0},
     {-2.8, -2.7, 1.10, -2.8, 2.7, 1.10, 1.0, -0.65},
     true},
    kLobes[5],
    kLobes[6],
}};

// Heights of the enamel's and of the dentin's occlusal surface. The grooves of a molar are the
// seams between its lobes: where the two highest lobes are level, a fissure is cut.
struct Occlusal {
  Jet enamel, dentin;
  double x = std::nan(""), y = std::nan("");  // where: whatever the height
};

Occlusal occlusal(const Point& p, std::span<const Lobe> lobes) {
  constexpr double kCrest = 0.7;  // radius of the crests, mm
  std::array<Jet, kLobes.size()> heights;
  const std::span<Jet> h(heights.data(), lobes.size());
  for (std::size_t k = 0; k < lobes.size(); ++k) {
    h[k] = ridge_height(p, lobes[k].triangular, kCrest);
    if (lobes[k].cusp) h[k] = smooth_max(h[k], ridge_height(p, lobes[k].cuspal, kCrest), 0.6);
  }
  std::size_t first = 0, second = 1;
  if (h[1].value() > h[0].value()) std::swap(first, second);
  for (std::size_t k = 2; k < h.size(); ++k) {
    if (h[k].value() > h[first].value()) {
      second = first;
      first = k;
    } else if (h[k].value() > h[second].value()) {
      second = k;
    }
  }
  const auto soft_maximum = [&](double softness) {
    double sum = 0;
    Vec3 gradient = Vec3::Zero();
    for (const Jet& lobe : h) {
      const double w = std::exp((lobe.value() - h[first].value()) / softness);
      sum += w;
      gradient += w * lobe.derivatives();
    }
    return Jet(h[first].value() + softness * std::log(sum), gradient / sum);
  };
  const Jet from_axis2 = square(p.u) + square(p.v);
  // Deep in the middle of the crown, faint where a seam runs out over the rim.
  const Jet depth = 0.12 + 0.26 * bell(root(from_axis2 + 0.01) / 3.6);
  const Jet fissure = depth * bell((h[first] - h[second]) / 0.28);
  const Jet pits = 0.22 * bell(root(square(p.u) + square(p.v + 0.2) + 1e-4) / 0.4) +
                   0.18 * bell(root(square(p.u) + square(p.v + 3.2) + 1e-4) / 0.4) +
                   0.15 * bell(root(square(p.u) + square(p.v - 3.1) + 1e-4) / 0.4);
  Occlusal surface;
  const Jet low = soft_maximum(0.1);
  surface.enamel = kFossa + smooth_max(low, Jet(0.0), 0.5) - fissure - pits;
  // The dentin below is smoother; the cap is thickest over the cusps.
  const Jet smooth = smooth_max(soft_maximum(0.35), Jet(0.0), 1.0);
  surface.dentin = kFossa + smooth - 1.72 - 0.21 * smooth;
  return surface;
}

// ---- Roots ----------------------------------------

struct RootShape {
  // By height, at z = 0, 2.5, ... 12.5: centre, and half extents across (v) and along (u).
  std::array<double, 6> centre, across, along;
  double tip_start, tip_length;  // the apex is half an ellipsoid below tip_start
};
constexpr RootShape kMesialRoot = {{-1.7, -2.55, -3.05, -2.8, -2.3, -2.0},
                                   {0.6, 0.95, 1.35, 1.75, 2.1, 2.1},
                                   {1.0, 2.0, 3.0, 3.7, 3.9, 3.7},
                                   2.4,
                                   1.9};
constexpr RootShape kDistalRoot = {{3.45, 3.2, 2.85, 2.5, 2.15, 1.9},
                                   {0.65, 1.0, 1.45, 1.8, 2.1, 2.1},
                                   {0.9, 1.7, 2.65, 3.35, 3.7, 3.5},
                                   2.9,
                                   2.0};
constexpr RootShape kSingleRoot = {{0.5, 0.3, 0.1, 0.0, 0.0, 0.0},
                                   {0.9, 1.9, 2.8, 3.5, 3.9, 3.9},
                                   {1.0, 2.0, 3.0, 3.7, 4.0, 3.9},
                                   2.6,
                                   1.9};
constexpr double kRootStep = 2.5;

Jet root_function(const Point& p, const RootShape& r, double waist) {
  const Jet along = spline(r.along, 0, kRootStep, p.z);
  // Flattened to an hour-glass section: the concavities towards and away from the furcation.
  const Jet across = spline(r.across, 0, kRootStep, p.z) *
                     (1.0 - waist * step(Jet(10.0 - p.z), 0.0, 4.0) * bell(p.u / (0.45 * along)));
  const Jet v = p.v - spline(r.centre, 0, kRootStep, p.z);
  Jet sum = power(p.u / along, 2.4) + square(v / across) + 1e-9;
  if (p.z.value() < r.tip_start) sum += square((r.tip_start - p.z) / r.tip_length);
  const Jet above = p.z - 10.6;  // roots end inside the trunk
  return smooth_max((root(sum) - 1.0) * spline(r.across, 0, kRootStep, p.z), above, 2.0);
}

Jet roots(const Point& p) {
  return smooth_min(root_function(p, kMesialRoot, 0.22), root_function(p, kDistalRoot, 0.12), 0.6);
}

// The roof of the furcation, an arch between the two roots.
Jet furcation(const Point& p) { return (8.4 - 0.12 * square(p.v) - p.z) * 0.9; }

// ---- Pulp ----------------------------------------

// A cone with round ends: exact distance is not needed, only one that is smooth and of slope
// about 1.
struct Horn {
  double u0, v0, z0, r0, u1, v1, z1, r1;
};
// Horns under the cusps, then the canals: two mesial ones that meet near the apex, one distal.
constexpr std::array<Horn, 13> kHorns = {{
    {1.3, -1.4, 11.6, 0.75, 2.0, -2.1, 13.6, 0.28},
    {1.3, 0.8, 11.6, 0.7, 2.05, 0.9, 13.3, 0.25},
    {1.0, 1.6, 11.5, 0.6, 1.6, 2.4, 12.9, 0.22},
    {-1.4, -1.3, 11.6, 0.75, -2.2, -1.9, 13.7, 0.28},
    {-1.4, 1.3, 11.6, 0.7, -2.1, 1.8, 13.5, 0.26},
    {1.5, -1.9, 10.4, 0.42, 1.9, -2.6, 7.6, 0.33},
    {1.9, -2.6, 7.6, 0.33, 1.3, -2.85, 4.6, 0.27},
    {1.3, -2.85, 4.6, 0.27, 0.4, -2.25, 1.7, 0.2},
    {-1.5, -1.9, 10.4, 0.42, -1.8, -2.6, 7.6, 0.33},
    {-1.8, -2.6, 7.6, 0.33, -1.2, -2.85, 4.6, 0.27},
    {-1.2, -2.85, 4.6, 0.27, 0.2, -2.25, 1.7, 0.2},
    {0.0, 1.9, 10.4, 0.6, 0.0, 2.6, 6.6, 0.42},
    {0.0, 2.6, 6.6, 0.42, 0.0, 3.15, 2.1, 0.2},
}};

constexpr std::array<Horn, 4> kPremolarHorns = {{
    {1.3, 0.0, 11.6, 0.75, 2.0, 0.0, 13.5, 0.28},
    {-1.4, 0.0, 11.6, 0.75, -2.1, 0.0, 13.3, 0.26},
    {0.0, 0.0, 10.4, 0.6, 0.0, 0.1, 6.0, 0.4},
    {0.0, 0.1, 6.0, 0.4, 0.0, 0.4, 2.1, 0.2},
}};

Jet horn_function(const Point& p, const Horn& h) {
  const double du = h.u1 - h.u0, dv = h.v1 - h.v0, dz = h.z1 - h.z0;
  Jet t =
      ((p.u - h.u0) * du + (p.v - h.v0) * dv + (p.z - h.z0) * dz) / (du * du + dv * dv + dz * dz);
  if (t.value() < 0) t = Jet(0.0);
  if (t.value() > 1) t = Jet(1.0);
  return root(square(p.u - h.u0 - t * du) + square(p.v - h.v0 - t * dv) +
              square(p.z - h.z0 - t * dz) + 1e-9) -
         (h.r0 + (h.r1 - h.r0) * t);
}

Jet pulp(const Point& p, std::span<const Horn> horns) {
  // The chamber: a flattened box-like ellipsoid at the height of the neck.
  const Jet sum = power(p.u / 2.2, 3.0) + power((p.v + 0.05) / 2.45, 3.0) +
                  power((p.z - 11.2) / 0.95, 3.0) + 1e-9;
  const double g = std::cbrt(sum.value());
  Jet all = (chain(sum, g, g / (3 * sum.value())) - 1.0) * 1.2;
  for (const Horn& h : horns) all = smooth_min(all, horn_function(p, h), 0.3);
  return all;
}

float distance(const Jet& f) {
  return static_cast<float>(f.value() / std::max(f.derivatives().norm(), 0.5));
}

}  // namespace

namespace {

// Of an unworn tooth that stands upright. `top` may be that of a place above or below, and becomes
// that of this one.
ToothSample sample_form(const Vec3& x, bool premolar, Occlusal& top) {
  const double buccolingual = premolar ? kPremolarWidth : 1,
               mesiodistal = premolar ? kPremolarLength : 1;
  const Point p{Jet((x.x() - kAxisX) / buccolingual, Vec3::UnitX() / buccolingual),
                Jet((x.y() - kAxisY) / mesiodistal, Vec3::UnitY() / mesiodistal),
                Jet(x.z(), Vec3::UnitZ())};
  const std::span<const Lobe> lobes = premolar ? std::span<const Lobe>(kPremolarLobes) : kLobes;
  const std::span<const Horn> horns = premolar ? std::span<const Horn>(kPremolarHorns) : kHorns;
  // Parts are left out where they are too far away to matter.
  const bool near_top = x.z() > 12.8, near_roots = x.z() < 14.2;
  const Jet cej = above_cej(p), walls = side_walls(p);
  const Jet root_part = !near_roots ? Jet(0.0)
                        : premolar  ? root_function(p, kSingleRoot, 0.12)
                                    : roots(p);
  if (near_top && !(top.x == x.x() && top.y == x.y())) {
    top = occlusal(p, lobes);
    top.x = x.x(), top.y = x.y();
  }

  const auto body = [&](const Jet& sides, const Jet& height) {
    constexpr double kSlopeFactor = 0.85;  // brings (z - H) near a distance before it is blended
    Jet f = near_top ? smooth_max(sides, (p.z - height) * kSlopeFactor, 1.3) : sides;
    if (near_roots) f = smooth_min(smooth_max(f, furcation(p), 1.2), root_part, 1.0);
    return f;
  };
  const Jet outside = body(walls + furrows(p), top.enamel);

  // Enamel on the sides grows from nothing at the cemento-enamel junction; below it the dentin's
  // own body lies outside the tooth, so that nothing of the cap is left there.
  constexpr double kSideThickness = 1.45, kRise = 2.4;
  const double s = cej.value();
  const Jet side = s > 0 ? chain(cej, kSideThickness * (1 - std::exp(-s / kRise)),
                                 kSideThickness / kRise * std::exp(-s / kRise))
                         : chain(cej, kSideThickness / kRise * s, kSideThickness / kRise);
  const Jet dentin_body = body(walls + side, top.dentin);
  const Jet& dentin_side = dentin_body.value() < s ? dentin_body : cej;

  ToothSample sample;
  sample.solid = distance(outside);
  const float junction = distance(dentin_side);
  const float chamber = x.z() < 15.5 ? distance(pulp(p, horns)) : static_cast<float>(x.z() - 14.0);
  sample.tissue = {std::max(sample.solid, -junction), std::max({sample.solid, junction, -chamber}),
                   chamber};
  if (sample.solid < 0)
    sample.label = chamber < 0 ? Tissue::kPulp : junction > 0 ? Tissue::kEnamel : Tissue::kDentin;
  return sample;
}

// What of it lies where `outside` is below zero.
void cut_off(double outside, ToothSample& sample) {
  const auto wall = static_cast<float>(outside);
  sample.solid = std::max(sample.solid, wall);
  for (float& tissue : sample.tissue) tissue = std::max(tissue, wall);
  if (wall >= 0) sample.label = Tissue::kAir;
}

// Takes the upright tooth to where it stands.
Quat leaning(const MolarOptions& o) {
  return Quat(Eigen::AngleAxisd(units::from_degree(o.tilt_deg), Vec3(1, 1, 0).normalized()));
}

// sample_variant(), with a `top` as sample_form() takes it.
ToothSample sample_beside(const Vec3& x, const MolarOptions& o, Occlusal& top) {
  const Vec3 upright = o.tilt_deg == 0 ? x : leaning(o).conjugate() * (x - kCrown) + kCrown;
  ToothSample sample = sample_form(upright, o.premolar, top);
  if (o.worn > 0) cut_off(upright.z() - (kHighestTip - o.worn), sample);
  if (o.rootless) cut_off(kBelowNeck - upright.z(), sample);
  return sample;
}

}  // namespace

ToothSample sample_molar(const Vec3& x) {
  Occlusal top;
  return sample_form(x, false, top);
}

ToothSample sample_variant(const Vec3& x, const MolarOptions& o) {
  Occlusal top;
  return sample_beside(x, o, top);
}
Box molar_bounds() { return {Vec3(0.7, 0.0, 0.3), Vec3(11.6, 10.9, 19.4)}; }

Box molar_bounds(const MolarOptions& o) {
  Box box = molar_bounds();
  if (o.tilt_deg == 0) return box;
  Box leant{Vec3::Constant(1e30), Vec3::Constant(-1e30)};
  for (int c = 0; c < 8; ++c) {
    const Vec3 corner((c & 1 ? box.max : box.min).x(), (c & 2 ? box.max : box.min).y(),
                      (c & 4 ? box.max : box.min).z());
    const Vec3 x = leaning(o) * (corner - kCrown) + kCrown;
    leant.min = leant.min.cwiseMin(x);
    leant.max = leant.max.cwiseMax(x);
  }
  return leant;
}

void check_molar_options(const MolarOptions& o) {
  if (!(o.voxel >= 0.02 && o.voxel <= 0.5))
    throw Error("molar: the voxel size must lie in [0.02, 0.5] mm, got " +
                fmt::format("{:g}", o.voxel));
  if (!(o.worn >= 0 && o.worn <= kMostWorn))
    throw Error(
        fmt::format("molar: {:g} mm worn off is not within 0 to {:g} mm", o.worn, kMostWorn));
  if (!(std::abs(o.tilt_deg) <= 180))
    throw Error(fmt::format("molar: a tilt of {:g} degrees is not within 180", o.tilt_deg));
}

LayeredTooth make_molar(const MolarOptions& o) {
  check_molar_options(o);
  const Lattice lattice{Vec3::Constant(o.voxel / 2), o.voxel};
  const Box box = molar_bounds(o);
  const Index3 lower = lattice.to_index(box.min).array().floor().matrix().cast<int>();
  const Index3 upper = lattice.to_index(box.max).array().ceil().matrix().cast<int>();

  // A brick whose centre is this far from every surface holds none. Away from a surface f/|grad f|
  // is not a bound of the distance, hence the factor, which a test checks against sampling every
  // voxel.
  constexpr double kCaution = 2.0;
  const double half = o.voxel * (kBrickEdge - 1) / 2.0;
  const double far = kCaution * half * std::sqrt(3.0) + kBandVoxels * o.voxel;
  std::atomic<int> begun{0};  // bricks, of about so many:
  const double bricks = ((upper - lower).cast<double>() / kBrickEdge).array().ceil().prod();
  LayeredTooth tooth =
      build_tooth_by_brick(lattice, lower, upper, [&](const Index3& first, ToothSample* samples) {
        if (o.progress) o.progress(std::min(1.0, begun++ / bricks));
        const Vec3 middle = lattice.to_world(first) + Vec3::Constant(half);
        const ToothSample s = sample_variant(middle, o);
        if (std::abs(s.solid) > far &&
            (s.solid > 0 || std::all_of(s.tissue.begin(), s.tissue.end(),
                                        [&](float d) { return std::abs(d) > far; }))) {
          std::fill(samples, samples + kBrickVoxels, s);
          return;
        }
        Occlusal top;
        for (int v = 0; v < kBrickVoxels; ++v)
          samples[v] =
              sample_beside(lattice.to_world(first + Index3(v >> 6, (v >> 3) & 7, v & 7)), o, top);
      });
  describe_molar(o, tooth);
  return tooth;
}

void describe_molar(const MolarOptions& o, LayeredTooth& tooth) {
  const auto direction = [&](const Vec3& upright) {
    const Vec3 d = o.tilt_deg == 0 ? upright : Vec3(leaning(o) * upright);
    return fmt::format("{:g} {:g} {:g}", d.x(), d.y(), d.z());
  };
  tooth.provenance["source"] = std::string("specimen molar") + (o.premolar ? ", premolar" : "") +
                               (o.worn > 0 ? fmt::format(", {:g} mm worn off", o.worn) : "") +
                               (o.rootless ? ", rootless" : "");
  tooth.provenance["axis_occlusal"] = direction(Vec3::UnitZ());
  tooth.provenance["axis_mesial"] = direction(Vec3(0, -1, 0));
  tooth.provenance["axis_buccal"] = direction(Vec3::UnitX());
}

}  // namespace toothprep
