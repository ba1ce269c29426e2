#include "toothprep/proof/specimen/cavity_shape.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

// Signed distance to a convex corner of two half-planes whose edge is rounded by `radius`, from the
// signed distances a and b to their borders and the cosine between their outward normals; exact
// outside, and inside too.
double corner_distance(double a, double b, double cosine, double radius = 0) {
  a += radius;
  b += radius;
  if (a - b * cosine <= 0 || b - a * cosine <= 0 || (a <= 0 && b <= 0))
    return std::max(a, b) - radius;
  return std::sqrt((a * a + b * b - 2 * a * b * cosine) / (1 - cosine * cosine)) - radius;
}

// The cavity in a plane across a stump's wall: q outwards, the wall at q0 on the shoulder's level.
double beside_wall(const CavityOptions& o, double q, double w, double q0, double slope) {
  const double w0 = -o.shoulder_level, fall = tan_degree(o.shoulder_slope);
  const double wall = 1 / std::hypot(1, slope), ledge = 1 / std::hypot(1, fall);
  const double within = (q0 - q - (w - w0) * slope) * wall;
  const double below = (w0 - w - (q - q0) * fall) * ledge;
  const double beside =
      corner_distance(below, within, (fall + slope) * ledge * wall, o.shoulder_radius);
  if (!(o.occlusal_radius > 0)) return beside;
  // What the rounding takes off the edge, down to where it leaves the wall.
  const double top = -o.occlusal_reduction, radius = o.occlusal_radius;
  const double edge = corner_distance(w - top, -within, slope * wall, radius);
  return std::min(beside, std::max(-edge, top - radius * (1 - slope * wall) - w));
}

// Distance to the parabola y = k u² (k not 0), negative above it. The foot t solves
// 2k²t³ + (1 - 2ky)t - u = 0.
double parabola_distance(double u, double y, double k) {
  const double p = (1 - 2 * k * y) / (2 * k * k), q = -u / (2 * k * k);
  const double discriminant = q * q / 4 + p * p * p / 27;
  std::array<double, 3> feet;
  int count = 0;
  if (discriminant > 0) {
    // The one real root, by Cardano without cancellation.
    const double a = -q / 2, b = std::sqrt(discriminant);
    const double s = std::cbrt(a + std::copysign(b, a));
    feet[count++] = s != 0 ? s - p / (3 * s) : 0;
  } else {
    const double r = std::sqrt(-p / 3);
    const double phi = r > 0 ? std::acos(std::clamp(-q / (2 * r * r * r), -1.0, 1.0)) / 3 : 0;
    for (int i = 0; i < 3; ++i) feet[count++] = 2 * r * std::cos(phi - 2 * i * units::kPi / 3);
  }
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < count; ++i) {
    double t = feet[i];
    for (int pass = 0; pass < 3; ++pass) {  // for a faint bow the cubic is badly scaled
      const double slope = 6 * k * k * t * t + 1 - 2 * k * y;
      if (std::abs(slope) > 1e-9) t -= (2 * k * k * t * t * t + (1 - 2 * k * y) * t - u) / slope;
    }
    least = std::min(least, std::hypot(u - t, y - k * t * t));
  }
  return y > k * u * u ? -least : least;
}

double extension(const CavityOptions& o) { return 1 + o.offset + 4 * o.voxel; }

// The distance of p to the part of a stump's cavity beside its walls and above its shoulder.
double beside_stump(const CavityOptions& o, const Plan& stump, const Vec3& p) {
  if (stump.round > 0)
    return beside_wall(o, rectangle_distance(p.x(), p.y(), stump.half_u, stump.half_v), p.z(),
                       stump.round, tan_degree(o.convergence_u / 2));
  // By the symmetry of the pair, the wall on p's side is the nearer one.
  return std::min(
      beside_wall(o, std::abs(p.x()), p.z(), stump.half_u, tan_degree(o.convergence_u / 2)),
      beside_wall(o, std::abs(p.y()), p.z(), stump.half_v, tan_degree(o.convergence_v / 2)));
}

}  // namespace

double tan_degree(double degrees) { return std::tan(units::from_degree(degrees)); }

double rectangle_distance(double u, double v, double half_u, double half_v) {
  const double a = std::abs(u) - half_u, b = std::abs(v) - half_v;
  return std::hypot(std::max(a, 0.0), std::max(b, 0.0)) + std::min(std::max(a, b), 0.0);
}

Plan tooth_plan(const CavityOptions& o) {
  return {o.size.x() / 2 - o.corner, o.size.z() / 2 - o.corner, o.corner};
}

Plan stump_plan(const CavityOptions& o) {
  const double round = o.stump_corner.value_or(std::max(0.0, o.corner - o.shoulder_width));
  return {o.size.x() / 2 - o.shoulder_width - round, o.size.z() / 2 - o.shoulder_width - round,
          round};
}

double tooth_distance(const CavityOptions& o, const Vec3& p) {
  const Plan plan = tooth_plan(o);
  const double q = rectangle_distance(p.x(), p.y(), plan.half_u, plan.half_v) - plan.round;
  const double height = o.size.y();
  const double r = std::abs(p.z() + height / 2) - height / 2;
  return std::hypot(std::max(q, 0.0), std::max(r, 0.0)) + std::min(std::max(q, r), 0.0);
}

ConvexPolyhedron pulp_box(const CavityOptions& o) {
  const Vec3 half(o.pulp_size.x() / 2, o.pulp_size.z() / 2, 0);
  return box_polyhedron(-half - Vec3(0, 0, *o.pulp_depth + o.pulp_size.y()),
                        half - Vec3(0, 0, *o.pulp_depth));
}

ConvexPolyhedron neighbour_box(const CavityOptions& o) {
  const double start = o.size.x() / 2 + *o.neighbour_gap;
  return box_polyhedron({start, -o.size.z() / 2, -o.size.y()},
                        {start + o.size.x(), o.size.z() / 2, 0});
}

double floor_height(const CavityOptions& o, double u, double v) {
  return -o.depth + u * tan_degree(o.floor_tilt_u) + v * tan_degree(o.floor_tilt_v) +
         o.bow * (2 * u / o.length) * (2 * u / o.length);
}

FloorEnds bowed_floor_ends(const CavityOptions& o) {
  // u = length/2 + k u² tan(taper), of the two roots the one that goes to length/2 as k goes to 0.
  const double k = 4 * o.bow / (o.length * o.length);
  const auto end = [&](double taper) {
    return o.length / (1 + std::sqrt(1 - 2 * k * tan_degree(taper) * o.length));
  };
  return {-end(o.taper_u_minus), end(o.taper_u_plus)};
}

std::vector<Vec3> flat_floor(const CavityOptions& o) {
  ConvexPolyhedron part = planes_moved(cavity_parts(o, side_end(o)).front(), o.offset);
  if (o.kind == CavityKind::kClass2) {
    HalfSpace axial = half_space(Vec3(1, 0, tan_degree(o.axial_taper)),
                                 Vec3(o.size.x() / 2 - o.axial_depth, 0, -o.gingival_depth));
    axial.offset -= o.offset;
    part = clipped(part, axial);
  }
  const Vec3 down = Vec3(tan_degree(o.floor_tilt_u), tan_degree(o.floor_tilt_v), -1).normalized();
  for (const PolyhedronFace& face : part.faces)
    if ((face.plane.normal - down).norm() < 1e-12) return face.corners;
  return {};
}

double stump_wall_to_pulp(const CavityOptions& o) {
  // Nearest along the pulp's vertical edges, where the distance to the convex parts beside the
  // walls is a convex function of the height.
  const Plan stump = stump_plan(o);
  const auto at = [&](double w) {
    return beside_stump(o, stump, {o.pulp_size.x() / 2, o.pulp_size.z() / 2, w});
  };
  double high = std::min(-*o.pulp_depth, -o.occlusal_reduction),
         low = -*o.pulp_depth - o.pulp_size.y();
  if (high < low) return std::numeric_limits<double>::infinity();
  for (int pass = 0; pass < 200; ++pass) {
    const double a = low + (high - low) / 3, b = high - (high - low) / 3;
    (at(a) < at(b) ? high : low) = at(a) < at(b) ? b : a;
  }
  return at((low + high) / 2);
}

double side_end(const CavityOptions& o) {
  return o.size.x() / 2 + o.neighbour_gap.value_or(0) + o.neighbour_damage + extension(o);
}
double damage_end(const CavityOptions& o) {
  return o.size.x() / 2 + o.neighbour_gap.value_or(0) + o.neighbour_damage;
}

std::vector<ConvexPolyhedron> cavity_parts(const CavityOptions& o, double end) {
  const double top = extension(o);
  // A wall with the outward direction `out` in plan, at `distance` along it on the level `level`.
  const auto wall = [](const Vec3& out, double distance, double level, double taper) {
    return half_space(out - tan_degree(taper) * Vec3::UnitZ(),
                      distance * out + level * Vec3::UnitZ());
  };
  const double far = 4 * o.size.maxCoeff() + 4;
  const ConvexPolyhedron space = box_polyhedron({-far, -far, -far}, {far, far, top});
  const auto cut = [&](std::initializer_list<HalfSpace> planes) {
    ConvexPolyhedron body = space;
    for (const HalfSpace& plane : planes) body = clipped(body, plane);
    return body;
  };
  const Vec3 u = Vec3::UnitX(), v = Vec3::UnitY(), w = Vec3::UnitZ();
  const HalfSpace lingual = wall(-v, o.width / 2, -o.depth, o.taper_v_minus),
                  buccal = wall(v, o.width / 2, -o.depth, o.taper_v_plus);
  const HalfSpace floor =
      o.bow != 0 ? HalfSpace{-w, o.size.y() + 2}
                 : half_space(u * tan_degree(o.floor_tilt_u) + v * tan_degree(o.floor_tilt_v) - w,
                              -o.depth * w);
  if (o.kind == CavityKind::kBox)
    return {cut({wall(u, o.length / 2, -o.depth, o.taper_u_plus),
                 wall(-u, o.length / 2, -o.depth, o.taper_u_minus), lingual, buccal, floor})};
  const double axial = o.size.x() / 2 - o.axial_depth;  // at the gingival floor
  const double axial_at_floor = axial - (o.gingival_depth - o.depth) * tan_degree(o.axial_taper);
  return {cut({{u, end},
               wall(-u, o.length - axial_at_floor, -o.depth, o.taper_u_minus),
               lingual,
               buccal,
               floor}),
          cut({{u, end},
               wall(-u, -axial, -o.gingival_depth, o.axial_taper),
               wall(-v, o.proximal_width / 2, -o.gingival_depth, o.proximal_taper),
               wall(v, o.proximal_width / 2, -o.gingival_depth, o.proximal_taper),
               {-w, o.gingival_depth}})};
}

CavityShape::CavityShape(const CavityOptions& options, double end) : options_(options) {
  if (options.kind == CavityKind::kStump)
    stump_ = stump_plan(options);
  else
    parts_ = cavity_parts(options, end);
}

double CavityShape::distance(const Vec3& p) const {
  const CavityOptions& o = options_;
  double least = std::numeric_limits<double>::infinity();
  if (o.kind == CavityKind::kStump) {
    least = std::min(-o.occlusal_reduction - p.z(), beside_stump(o, stump_, p));
  } else {
    for (const ConvexPolyhedron& part : parts_) least = std::min(least, part.distance(p));
    if (o.bow != 0)
      least = std::max(
          least, parabola_distance(p.x(), p.z() + o.depth, 4 * o.bow / (o.length * o.length)));
  }
  return least - o.offset;
}

}  // namespace toothprep
