// The closed forms of cavity_truth().
#include <algorithm>
#include <cmath>
#include <limits>

#include "toothprep/proof/specimen/cavity.h"
#include "toothprep/proof/specimen/cavity_shape.h"
#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// ---- Quadrature -----------------------------------

// Five Gauss points: exact for polynomials up to degree 9.
template <class F>
double integral_of_polynomial(double a, double b, const F& f) {
  constexpr double kX[] = {0, 0.5384693101056831, 0.9061798459386640};
  constexpr double kW[] = {0.5688888888888889, 0.4786286704993665, 0.2369268850561891};
  const double m = (a + b) / 2, h = (b - a) / 2;
  double sum = kW[0] * f(m);
  for (const int i : {1, 2}) sum += kW[i] * (f(m - h * kX[i]) + f(m + h * kX[i]));
  return h * sum;
}

// Tanh-sinh: analytic inside (a, b), with roots at the ends allowed.
template <class F>
double integral_with_roots(double a, double b, const F& f) {
  if (!(b > a)) return 0;
  const double m = (a + b) / 2, h = (b - a) / 2;
  constexpr double kStep = 1.0 / 32;
  double sum = 0;
  for (int i = -112; i <= 112; ++i) {
    const double s = units::kPi / 2 * std::sinh(i * kStep);
    const double weight = units::kPi / 2 * std::cosh(i * kStep) / (std::cosh(s) * std::cosh(s));
    sum += weight * f(m + h * std::tanh(s));
  }
  return h * kStep * sum;
}

// Over [a, b], cut at the breaks that lie in it.
template <class Rule>
double in_pieces(double a, double b, std::vector<double> breaks, const Rule& rule) {
  breaks.push_back(a);
  breaks.push_back(b);
  std::sort(breaks.begin(), breaks.end());
  double sum = 0;
  for (std::size_t i = 0; i + 1 < breaks.size(); ++i) {
    const double low = std::max(a, breaks[i]), high = std::min(b, breaks[i + 1]);
    if (high > low) sum += rule(low, high);
  }
  return sum;
}

// ---- Volumes: total, below the enamel's border, of the pulp, of the neighbour -------

struct Volumes {
  double total = 0, below_enamel = 0, pulp = 0, other = 0;
  bool known = true, tissues_known = true;
};

ConvexPolyhedron below(const ConvexPolyhedron& body, double level) {
  return clipped(body, {Vec3::UnitZ(), level});
}

// The parts of a union with the signs of inclusion and exclusion.
struct Piece {
  ConvexPolyhedron body;
  double sign = 1;
};
std::vector<Piece> pieces_of(const std::vector<ConvexPolyhedron>& parts) {
  std::vector<Piece> pieces;
  for (const ConvexPolyhedron& part : parts) pieces.push_back({part, 1});
  if (parts.size() == 2) pieces.push_back({intersection(parts[0], parts[1]), -1});
  return pieces;
}

Volumes flat_volumes(const CavityOptions& o) {
  Volumes volume;
  std::vector<ConvexPolyhedron> parts = cavity_parts(o, side_end(o));
  double pulp_distance = kInfinity;
  if (o.pulp_depth)
    for (const ConvexPolyhedron& part : parts)
      pulp_distance = std::min(pulp_distance, distance_between(part, pulp_box(o)));
  for (Piece piece : pieces_of(parts)) {
    if (o.kind == CavityKind::kClass2)
      piece.body = clipped(piece.body, {Vec3::UnitX(), o.size.x() / 2});
    volume.total += piece.sign * volume_mm3(below(piece.body, 0));
    volume.below_enamel += piece.sign * volume_mm3(below(piece.body, -o.enamel));
    if (o.pulp_depth) volume.pulp += piece.sign * volume_mm3(intersection(piece.body, pulp_box(o)));
  }
  if (o.neighbour_damage > 0)
    for (const Piece& piece : pieces_of(cavity_parts(o, damage_end(o))))
      volume.other += piece.sign * volume_mm3(intersection(piece.body, neighbour_box(o)));
  if (o.offset > 0) {
    volume.known = o.kind == CavityKind::kBox;
    if (volume.known) {
      const Vec3 up = Vec3::UnitZ();
      volume.total += shell_volume_mm3(parts[0], o.offset, up, -1e3, 0, volume.known);
      volume.below_enamel +=
          shell_volume_mm3(parts[0], o.offset, up, -1e3, -o.enamel, volume.tissues_known);
    }
    if (pulp_distance < o.offset) volume.tissues_known = false;
  }
  return volume;
}

// A box with a bowed floor. The section across u between two levels is a trapezoid.
struct BowedBox {
  explicit BowedBox(const CavityOptions& options)
      : o(options),
        k(4 * o.bow / (o.length * o.length)),
        u_plus(tan_degree(o.taper_u_plus)),
        u_minus(tan_degree(o.taper_u_minus)),
        v_plus(tan_degree(o.taper_v_plus)),
        v_minus(tan_degree(o.taper_v_minus)),
        ends(bowed_floor_ends(o)) {}

  double floor(double u) const { return -o.depth + k * u * u; }
  double width(double w) const { return o.width + (w + o.depth) * (v_plus + v_minus); }
  // Width (or, with `area`, one) integrated over the levels of the column at u below `level`.
  double column(double u, double level, bool area) const {
    double low = floor(u), high = level;
    for (const auto& [along, slope] : {std::pair{u, u_plus}, {-u, u_minus}}) {
      const double over = along - o.length / 2;  // inside where over <= (w + depth) slope
      if (slope > 0) low = std::max(low, over / slope - o.depth);
      if (slope < 0) high = std::min(high, over / slope - o.depth);
      if (slope == 0 && over > 0) return 0;
    }
    if (high <= low) return 0;
    return area ? high - low
                : integral_of_polynomial(low, high, [&](double w) { return width(w); });
  }
  double wall(double w, bool plus) const {
    return (o.length / 2 + (w + o.depth) * (plus ? u_plus : u_minus)) * (plus ? 1 : -1);
  }
  double volume_below(double level, bool area = false) const {
    std::vector<double> breaks = {0, ends.low, ends.high};
    for (const double w : {level, -o.depth}) {
      breaks.push_back(wall(w, true));
      breaks.push_back(wall(w, false));
    }
    if ((level + o.depth) / k > 0)
      for (const double sign : {-1.0, 1.0})
        breaks.push_back(sign * std::sqrt((level + o.depth) / k));
    const auto [low, high] = std::minmax_element(breaks.begin(), breaks.end());
    const double a = *low, b = *high;
    return in_pieces(a, b, breaks, [&](double from, double to) {
      return integral_of_polynomial(from, to, [&](double u) { return column(u, level, area); });
    });
  }
  template <class F>
  double over_floor(const F& f) const {
    return in_pieces(ends.low, ends.high, {0},
                     [&](double a, double b) { return integral_of_polynomial(a, b, f); });
  }

  const CavityOptions& o;
  double k, u_plus, u_minus, v_plus, v_minus;
  FloorEnds ends;
};

// The outline of a stump's core at a level, with its offset.
double core_at(const CavityOptions& o, double at_shoulder, double slope, double w) {
  const double up = w + o.shoulder_level;
  if (o.offset > 0 &&
      up < -o.offset * slope / std::hypot(1, slope))  // the rounded inner line angle
    return at_shoulder - std::sqrt(std::max(0.0, o.offset * o.offset - up * up));
  return at_shoulder - up * slope - o.offset * std::hypot(1, slope);
}

double core_area(const CavityOptions& o, double w) {
  const Plan s = stump_plan(o);
  const double tu = tan_degree(o.convergence_u / 2), tv = tan_degree(o.convergence_v / 2);
  if (s.round == 0) return 4 * core_at(o, s.half_u, tu, w) * core_at(o, s.half_v, tv, w);
  const double r = core_at(o, s.round, tu, w);
  return 4 * s.half_u * s.half_v + 4 * (s.half_u + s.half_v) * r + units::kPi * r * r;
}

Volumes stump_volumes(const CavityOptions& o) {
  const Plan tooth = tooth_plan(o);
  const double outline = 4 * tooth.half_u * tooth.half_v +
                         4 * (tooth.half_u + tooth.half_v) * tooth.round +
                         units::kPi * tooth.round * tooth.round;
  const double top = -o.occlusal_reduction - o.offset, bottom = -o.shoulder_level - o.offset;
  std::vector<double> breaks;
  for (const double convergence : {o.convergence_u, o.convergence_v}) {
    const double slope = tan_degree(convergence / 2);
    breaks.push_back(-o.shoulder_level - o.offset * slope / std::hypot(1, slope));
  }
  const auto removed_below = [&](double level) {
    const double sides =
        in_pieces(bottom, std::clamp(level, bottom, top), breaks, [&](double a, double b) {
          return integral_with_roots(a, b, [&](double w) { return outline - core_area(o, w); });
        });
    return sides + outline * std::max(0.0, level - top);
  };
  Volumes volume;
  volume.known = volume.tissues_known = !has_shaped_profile(o);
  volume.total = removed_below(0);
  volume.below_enamel = removed_below(-o.enamel);
  if (o.pulp_depth)
    volume.pulp =
        o.pulp_size.x() * o.pulp_size.z() * std::clamp(-*o.pulp_depth - top, 0.0, o.pulp_size.y());
  return volume;
}

Volumes volumes_of(const CavityOptions& o) {
  if (o.kind == CavityKind::kStump) return stump_volumes(o);
  if (o.bow == 0) return flat_volumes(o);
  const BowedBox box(o);
  Volumes volume;
  volume.total = box.volume_below(0);
  volume.below_enamel = box.volume_below(-o.enamel);
  return volume;
}

// ---- Figures of a box and of a class II cavity ----------

struct Wall {
  std::string name;
  int part;
  Vec3 out;  // in plan
  double taper;
};

std::vector<Wall> walls_of(const CavityOptions& o) {
  const Vec3 u = Vec3::UnitX(), v = Vec3::UnitY();
  if (o.kind == CavityKind::kBox)
    return {{"mesial", 0, u, o.taper_u_plus},
            {"distal", 0, -u, o.taper_u_minus},
            {"buccal", 0, v, o.taper_v_plus},
            {"lingual", 0, -v, o.taper_v_minus}};
  return {
      {"distal", 0, -u, o.taper_u_minus},          {"buccal", 0, v, o.taper_v_plus},
      {"lingual", 0, -v, o.taper_v_minus},         {"axial", 1, -u, o.axial_taper},
      {"proximal_buccal", 1, v, o.proximal_taper}, {"proximal_lingual", 1, -v, o.proximal_taper}};
}

struct FloorFigures {
  double lowest = 0, highest = 0;                     // levels
  double percent5 = 0, percent50 = 0, percent95 = 0;  // this share of the floor's area is lower
  double tilt_deg = 0, flatness = 0;
};

// The levels below which 5, 50 and 95 % of the floor's area lie.
template <class F>
void set_percentiles(FloorFigures& f, double area, const F& area_below) {
  const auto level_of = [&](double share) {
    double low = f.lowest, high = f.highest;
    for (int pass = 0; pass < 100 && high > low; ++pass) {
      const double middle = (low + high) / 2;
      (area_below(middle) < share * area ? low : high) = middle;
    }
    return (low + high) / 2;
  };
  f.percent5 = level_of(0.05);
  f.percent50 = level_of(0.5);
  f.percent95 = level_of(0.95);
}

FloorFigures flat_floor_figures(const CavityOptions& o) {
  FloorFigures f;
  const std::vector<Vec3> corners = flat_floor(o);
  f.lowest = kInfinity;
  f.highest = -kInfinity;
  for (const Vec3& corner : corners) {
    f.lowest = std::min(f.lowest, corner.z());
    f.highest = std::max(f.highest, corner.z());
  }
  f.tilt_deg = units::to_degree(
      std::atan(std::hypot(tan_degree(o.floor_tilt_u), tan_degree(o.floor_tilt_v))));
  const auto area_below = [&](double level) {
    std::vector<Vec3> part;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      const Vec3 &a = corners[i], &b = corners[(i + 1) % corners.size()];
      if (a.z() <= level) part.push_back(a);
      if ((a.z() - level) * (b.z() - level) < 0)
        part.push_back(a + (level - a.z()) / (b.z() - a.z()) * (b - a));
    }
    return area_mm2(part);
  };
  set_percentiles(f, area_mm2(corners), area_below);
  return f;
}

FloorFigures bowed_floor_figures(const CavityOptions& o) {
  const BowedBox box(o);
  FloorFigures f;
  const double ends[] = {box.floor(box.ends.low), box.floor(box.ends.high)};
  f.lowest = std::min({-o.depth, ends[0], ends[1]});
  f.highest = std::max({-o.depth, ends[0], ends[1]});
  // Best plane w = a + b u + c v by least squares over the floor's area in plan, v integrated in
  // closed form.
  Mat3 normal = Mat3::Zero();
  Vec3 right = Vec3::Zero();
  double squares = 0;
  const auto moments = [&](double u, int power) {
    const double w = box.floor(u) + o.depth;
    const double low = -o.width / 2 - w * box.v_minus, high = o.width / 2 + w * box.v_plus;
    return (std::pow(high, power + 1) - std::pow(low, power + 1)) / (power + 1);
  };
  const int powers[3][2] = {{0, 0}, {1, 0}, {0, 1}};  // of u and v in 1, u, v
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j)
      normal(i, j) = box.over_floor([&](double u) {
        return std::pow(u, powers[i][0] + powers[j][0]) * moments(u, powers[i][1] + powers[j][1]);
      });
    right[i] = box.over_floor([&](double u) {
      return std::pow(u, powers[i][0]) * box.k * u * u * moments(u, powers[i][1]);
    });
  }
  squares = box.over_floor([&](double u) { return box.k * u * u * box.k * u * u * moments(u, 0); });
  const Vec3 plane = normal.inverse() * right;
  const double residual = squares - 2 * plane.dot(right) + plane.dot(normal * plane);
  const double slope = std::hypot(plane[1], plane[2]);
  f.tilt_deg = units::to_degree(std::atan(slope));
  f.flatness = std::sqrt(std::max(0.0, residual / normal(0, 0)) / (1 + slope * slope));
  // Below a level lies |u| < sqrt of the height over k, or, of a hump, what is beyond.
  const auto area_below = [&](double level) {
    const double reach = std::sqrt(std::max(0.0, (level + o.depth) / box.k));
    const double a = std::max(box.ends.low, -reach), b = std::min(box.ends.high, reach);
    const double near = in_pieces(a, b, {0}, [&](double from, double to) {
      return integral_of_polynomial(from, to, [&](double u) { return moments(u, 0); });
    });
    return box.k > 0 ? near : normal(0, 0) - near;
  };
  set_percentiles(f, normal(0, 0), area_below);
  return f;
}

// Of the cavity's walls as they stand, with the offset.
struct Undercut {
  double depth = 0, area = 0;
};

Undercut flat_undercut(const CavityOptions& o) {
  std::vector<ConvexPolyhedron> parts = cavity_parts(o, side_end(o));
  for (ConvexPolyhedron& part : parts) {
    part = below(planes_moved(part, o.offset), 0);
    if (o.kind == CavityKind::kClass2) part = clipped(part, {Vec3::UnitX(), o.size.x() / 2});
  }
  const ConvexPolyhedron common =
      parts.size() == 2 ? intersection(parts[0], parts[1]) : ConvexPolyhedron{};
  Undercut undercut;
  for (const Wall& wall : walls_of(o)) {
    if (wall.taper >= 0) continue;
    const Vec3 normal = (wall.out - tan_degree(wall.taper) * Vec3::UnitZ()).normalized();
    const auto face_of = [&](const ConvexPolyhedron& body) -> std::vector<Vec3> {
      for (const PolyhedronFace& face : body.faces)
        if ((face.plane.normal - normal).norm() < 1e-12) return face.corners;
      return {};
    };
    const auto face = face_of(parts[wall.part]);
    // An axial wall as wide as the isthmus ends at the pulpal floor.
    double edge = 0;
    if (wall.name == "axial") {
      const auto half = [&](double w) {
        return o.proximal_width / 2 + (w + o.gingival_depth) * tan_degree(o.proximal_taper) -
               o.width / 2 - (w + o.depth) * tan_degree(std::min(o.taper_v_plus, o.taper_v_minus));
      };
      if (half(0) < 1e-9 && half(-o.depth) < 1e-9) edge = -o.depth;
    }
    for (const Vec3& corner : face)
      undercut.depth = std::max(undercut.depth, -(edge - corner.z()) * tan_degree(wall.taper));
    undercut.area += area_mm2(face) - (common.empty() ? 0 : area_mm2(face_of(common)));
  }
  return undercut;
}

Undercut bowed_undercut(const CavityOptions& o, const FloorFigures& floor) {
  const BowedBox box(o);
  Undercut undercut;
  for (const Wall& wall : walls_of(o)) {
    const double slope = tan_degree(wall.taper);
    if (slope >= 0) continue;
    const bool end = wall.out.x() != 0;
    const double lowest =
        !end ? floor.lowest : box.floor(wall.out.x() > 0 ? box.ends.high : box.ends.low);
    undercut.depth = std::max(undercut.depth, lowest * slope);
    const double in_plan =
        end ? integral_of_polynomial(lowest, 0, [&](double w) { return box.width(w); })
            : box.volume_below(0, true);
    undercut.area += in_plan * std::hypot(1, slope);
  }
  return undercut;
}

// The pulp's box lies below the floor and in its middle: the nearest point of the cavity is one of
// the floor. Sampled, then refined about the best sample.
double bowed_floor_to_pulp(const CavityOptions& o) {
  const BowedBox box(o);
  const auto at = [&](double s, double t) {  // s, t in [0, 1] over the floor
    const double u = box.ends.low + s * (box.ends.high - box.ends.low), w = box.floor(u);
    const double low = -o.width / 2 - (w + o.depth) * box.v_minus;
    const double v = low + t * box.width(w);
    const double du = std::max(0.0, std::abs(u) - o.pulp_size.x() / 2);
    const double dv = std::max(0.0, std::abs(v) - o.pulp_size.z() / 2);
    return Vec3(du, dv, w + *o.pulp_depth).norm();
  };
  double s = 0.5, t = 0.5, reach = 0.5, least = kInfinity;
  for (int pass = 0; pass < 12; ++pass, reach /= 6) {
    const double s0 = s, t0 = t;
    for (int i = -24; i <= 24; ++i)
      for (int j = -24; j <= 24; ++j) {
        const double si = std::clamp(s0 + reach * i / 24, 0.0, 1.0),
                     tj = std::clamp(t0 + reach * j / 24, 0.0, 1.0), d = at(si, tj);
        if (d < least) {
          least = d;
          s = si;
          t = tj;
        }
      }
  }
  return least;
}

void add_volumes(const CavityOptions& o, CavityTruth& truth) {
  const auto put = [&](const char* key, double value) { truth.push_back({key, value}); };
  const Volumes v = volumes_of(o);
  if (v.known) {
    if (v.tissues_known) {
      put("removed_mm3.enamel", v.total - v.below_enamel);
      put("removed_mm3.dentin", v.below_enamel - v.pulp);
      put("removed_mm3.pulp", v.pulp);
      put("removed_mm3.other", v.other);
    }
    put("removed_mm3.total", v.total + v.other);
    if (o.neighbour_gap) put("neighbour_damage_mm3", v.other);
  }
  if (o.offset > 0) {
    if (v.known) {
      CavityOptions nominal = o;
      nominal.offset = 0;
      const double target = volumes_of(nominal).total;
      put("required_mm3", target);
      put("removed_inside_mm3", target);
      put("over_prepared_mm3", v.total - target);
      put("under_prepared_mm3", 0);
      put("dice", 2 * target / (v.total + target));
    }
    put("deviation_mean_mm", -o.offset);
    put("deviation_rms_mm", o.offset);
    put("deviation_p95_mm", o.offset);
    if (o.kind == CavityKind::kBox) put("hausdorff_mm", o.offset);
  }
}

// Along the best path of draw there is none if a tilted path frees all walls, and if opposite walls
// are alike the axis is the best path.
void add_undercut(const Undercut& along_axis, bool draws, bool alike, CavityTruth& truth) {
  truth.push_back({"undercut_along_axis_mm", along_axis.depth});
  truth.push_back({"undercut_along_axis_area_mm2", along_axis.area});
  truth.push_back({"undercut_draws", draws ? 1.0 : 0.0});
  if (!draws && !alike) return;
  truth.push_back({"undercut_max_mm", draws ? 0 : along_axis.depth});
  truth.push_back({"undercut_area_mm2", draws ? 0 : along_axis.area});
}

// Whether no tilt of the path makes the walls that don't draw any better.
bool opposite_alike(const CavityOptions& o) {
  const auto alike = [](double a, double b) { return a == b || (a >= 0 && b >= 0); };
  return alike(o.taper_u_plus, o.taper_u_minus) && alike(o.taper_v_plus, o.taper_v_minus);
}

// What is left around a box: at each wall, across the axis to the tooth's side.
void add_remaining_walls(const CavityOptions& o, CavityTruth& truth) {
  struct Strip {  // of a wall, as high as one of many equal steps
    double left, area;
  };
  const auto quantile = [](std::vector<Strip> strips, double share) {
    std::sort(strips.begin(), strips.end(),
              [](const Strip& a, const Strip& b) { return a.left < b.left; });
    double all = 0, below = 0;
    for (const Strip& strip : strips) all += strip.area;
    for (const Strip& strip : strips)
      if ((below += strip.area) >= share * all) return strip.left;
    return strips.back().left;
  };
  constexpr int kSteps = 3000;
  const double u_plus = tan_degree(o.taper_u_plus), u_minus = tan_degree(o.taper_u_minus),
               v_plus = tan_degree(o.taper_v_plus), v_minus = tan_degree(o.taper_v_minus);
  std::vector<Strip> middle;
  for (const auto& [name, slope] : {std::pair<std::string, double>{"mesial", u_plus},
                                    {"distal", u_minus},
                                    {"buccal", v_plus},
                                    {"lingual", v_minus}}) {
    const bool end = name == "mesial" || name == "distal";
    std::vector<Strip> upper;
    for (int n = 0; n < kSteps; ++n) {
      const double above = o.depth * (n + 0.5) / kSteps;  // the floor
      const double half = ((end ? o.size.x() : o.size.z()) - (end ? o.length : o.width)) / 2;
      const double across =
          end ? o.width + above * (v_plus + v_minus) : o.length + above * (u_plus + u_minus);
      const Strip strip{half - above * slope, across * std::hypot(1, slope)};
      if (3 * n >= 2 * kSteps) {
        upper.push_back(strip);
      } else if (3 * n >= kSteps) {
        middle.push_back(strip);
      }
    }
    if (end) truth.push_back({"marginal_ridge_mm." + name, quantile(upper, 0.25)});
  }
  truth.push_back({"wall_thickness_min_mm", quantile(middle, 0.02)});
}

void add_box(const CavityOptions& o, CavityTruth& truth) {
  const auto put = [&](const std::string& key, double value) { truth.push_back({key, value}); };
  const FloorFigures floor = o.bow != 0 ? bowed_floor_figures(o) : flat_floor_figures(o);
  const double slope = std::hypot(tan_degree(o.floor_tilt_u), tan_degree(o.floor_tilt_v));
  const double centre = o.depth + o.offset * std::hypot(1, slope);
  put("depth_mm", -floor.percent50);
  put("depth_min_mm", -floor.percent95);
  put("depth_max_mm", -floor.percent5);
  put("depth_least_mm", -floor.highest);
  put("depth_greatest_mm", -floor.lowest);
  put("depth_centre_mm", centre);
  put("floor_tilt_deg", floor.tilt_deg);
  put("floor_flatness_mm", floor.flatness);
  const bool class2 = o.kind == CavityKind::kClass2;
  for (const Wall& wall : walls_of(o)) put("wall_angles_deg." + wall.name, wall.taper);
  const double mesiodistal = -o.taper_u_plus - o.taper_u_minus,
               buccolingual = -o.taper_v_plus - o.taper_v_minus;
  put("convergence_deg.buccolingual", buccolingual);
  if (!class2) {
    put("convergence_deg.mesiodistal", mesiodistal);
    put("convergence_deg.mean", (mesiodistal + buccolingual) / 2);
  }
  // A wall's place at a level: nominal, and moved along its normal by the offset.
  const auto wall_at = [&](double at, double level, double taper, double w) {
    const double t = tan_degree(taper);
    return at + (w - level) * t + o.offset * std::hypot(1, t);
  };
  const double axial = o.size.x() / 2 - o.axial_depth;  // of class II, at the gingival floor
  for (const auto& [name, w] :
       {std::pair<std::string, double>{"_floor", -centre}, {"", -centre / 2}, {"_margin", 0.0}}) {
    const double distal =
        class2
            ? wall_at(o.length - axial + (o.gingival_depth - o.depth) * tan_degree(o.axial_taper),
                      -o.depth, o.taper_u_minus, w)
            : wall_at(o.length / 2, -o.depth, o.taper_u_minus, w);
    const double mesial = class2 ? -wall_at(-axial, -o.gingival_depth, o.axial_taper, w)
                                 : wall_at(o.length / 2, -o.depth, o.taper_u_plus, w);
    // The sides of a class II box are open: its length is that of the pulpal floor.
    if (!class2 || name == "_floor") put("length" + name + "_mm", distal + mesial);
    put("width" + name + "_mm", wall_at(o.width / 2, -o.depth, o.taper_v_plus, w) +
                                    wall_at(o.width / 2, -o.depth, o.taper_v_minus, w));
  }
  if (o.offset == 0) {
    put("line_angle_radius_mm", 0);
    if (!class2 && o.bow == 0 && slope == 0) add_remaining_walls(o, truth);
  }
  if (class2) {
    const double gingival = o.gingival_depth + o.offset;
    const double pulpal = centre;
    const auto width_at = [&](double w) {
      return 2 * wall_at(o.proximal_width / 2, -o.gingival_depth, o.proximal_taper, w);
    };
    const auto axial_depth_at = [&](double w) {
      return o.size.x() / 2 + wall_at(-axial, -o.gingival_depth, o.axial_taper, w);
    };
    put("isthmus_width_mm", *truth_value(truth, "width_mm"));
    put("box_width_mm", width_at(-gingival / 2));
    put("box_width_floor_mm", width_at(-gingival));
    put("gingival_depth_mm", gingival);
    put("axial_depth_floor_mm", axial_depth_at(-gingival));
    put("gingival_floor_width_mm", axial_depth_at(-gingival));
    put("convergence_deg.proximal", -2 * o.proximal_taper);
    put("gingival_floor_flatness_mm", 0);
    if (o.offset == 0) put("axiopulpal_radius_mm", 0);
    if (o.floor_tilt_u == 0 && o.floor_tilt_v == 0) {
      put("axial_wall_height_mm", gingival - pulpal);
      put("gingival_floor_tilt_deg", 0);
      put("axial_depth_mm", axial_depth_at(-(gingival + pulpal) / 2));
    }
    if (o.neighbour_gap) put("box_clearance_mm", *o.neighbour_gap);
  }
  const Undercut undercut = o.bow != 0 ? bowed_undercut(o, floor) : flat_undercut(o);
  double low = -o.taper_v_minus, high = o.taper_v_plus;
  if (class2) {
    low = std::max(low, -o.proximal_taper);
    high = std::min(high, o.proximal_taper);
  }
  add_undercut(undercut, high >= low && (class2 || mesiodistal <= 0), opposite_alike(o), truth);
  if (o.pulp_depth) {
    double distance = kInfinity;
    if (o.bow != 0) {
      distance = bowed_floor_to_pulp(o);
    } else {
      for (const ConvexPolyhedron& part : cavity_parts(o, side_end(o)))
        distance = std::min(distance, distance_between(part, pulp_box(o)));
    }
    put("remaining_dentin_min_mm", std::max(0.0, distance - o.offset));
    put("pulp_exposed", distance <= o.offset);
  }
}

// A stump's margin in a plane across its wall: where the shoulder, its rounding or its slope comes out at
// the tooth's side.
struct MarginProfile {
  double width = 0;      // mm, to the wall extended down
  double slope_deg = 0;  // how steeply the ledge falls outwards there
  double arc = 0;        // share of the ledge, from wall to finish line, that the rounding takes
};
MarginProfile margin_profile(const CavityOptions& o, double wall_slope) {
  const double fall = tan_degree(o.shoulder_slope), r = o.shoulder_radius;
  const double wall = std::hypot(1, wall_slope), ledge = std::hypot(1, fall);
  // q outwards and w up from where wall and ledge would meet; the arc's middle is r off both.
  const double determinant = 1 - wall_slope * fall;
  const double middle_q = r * (wall - wall_slope * ledge) / determinant;
  const double middle_w = r * (ledge - fall * wall) / determinant;
  const double tangent_q = middle_q - r * fall / ledge;
  MarginProfile profile;
  double w = -o.shoulder_width * fall;
  if (o.shoulder_width >= tangent_q) {
    profile.slope_deg = o.shoulder_slope;
    profile.arc = tangent_q / o.shoulder_width;
  } else {
    const double aside = middle_q - o.shoulder_width;
    w = middle_w - std::sqrt(r * r - aside * aside);
    profile.slope_deg = units::to_degree(std::asin(aside / r));
    profile.arc = 1;
  }
  profile.width = o.shoulder_width + w * wall_slope;
  return profile;
}

void add_profile(const CavityOptions& o, double wall_slope, CavityTruth& truth) {
  const MarginProfile margin = margin_profile(o, wall_slope);
  const auto put = [&](const std::string& key, double value) { truth.push_back({key, value}); };
  const bool chamfer = margin.arc > 0.5, bevel = !chamfer && margin.slope_deg > 30;
  put("margin_form.shoulder", !chamfer && !bevel);
  put("margin_form.chamfer", chamfer);
  put("margin_form.bevel", bevel);
  if (has_shaped_profile(o)) put("margin_width_mm", margin.width);
  const Plan stump = stump_plan(o);
  if (stump.round > 0 && std::abs(stump.round + o.shoulder_width - o.corner) < 1e-9) {
    put("margin_width_min_mm", margin.width);  // the same all around
    put("margin_width_max_mm", margin.width);
    put("finish_line_roughness_mm", 0);
    put("occlusoaxial_radius_min_mm", o.occlusal_radius);
  }
  put("margin_gaps", 0);
  put("margin_gap_longest_mm", 0);
  put("cavosurface_angle_deg", 90 + margin.slope_deg);
  put("line_angle_radius_mm", o.shoulder_radius);
  put("occlusoaxial_radius_mm", o.occlusal_radius);
  put("occlusoaxial_angle_deg", 90 + units::to_degree(std::atan(wall_slope)));
}

void add_stump(const CavityOptions& o, CavityTruth& truth) {
  const auto put = [&](const std::string& key, double value) { truth.push_back({key, value}); };
  const double tu = tan_degree(o.convergence_u / 2), tv = tan_degree(o.convergence_v / 2);
  const double height = o.shoulder_level - o.occlusal_reduction;
  for (const char* name : {"mesial", "distal"})
    put(std::string("wall_angles_deg.") + name, o.convergence_u / 2);
  for (const char* name : {"buccal", "lingual"})
    put(std::string("wall_angles_deg.") + name, o.convergence_v / 2);
  put("convergence_deg.mesiodistal", o.convergence_u);
  put("convergence_deg.buccolingual", o.convergence_v);
  put("convergence_deg.mean", (o.convergence_u + o.convergence_v) / 2);
  const auto half = [&](double at_shoulder, double t, double above) {
    return at_shoulder - above * t - o.offset * std::hypot(1, t);
  };
  const double u = o.size.x() / 2 - o.shoulder_width, v = o.size.z() / 2 - o.shoulder_width;
  for (const auto& [name, above] : {std::pair<std::string, double>{"_shoulder", -o.offset},
                                    {"", height / 2 - o.offset},
                                    {"_top", height - o.offset}}) {
    put("length" + name + "_mm", 2 * half(u, tu, above));
    put("width" + name + "_mm", 2 * half(v, tv, above));
  }
  if (o.offset == 0 && tu == tv) add_profile(o, tu, truth);
  put("occlusal_reduction_mm", o.occlusal_reduction + o.offset);
  if (!has_shaped_profile(o)) {
    // The mean of both pairs, where their convergence differs.
    put("margin_width_mm",
        (o.size.x() / 2 - half(u, tu, -o.offset) + o.size.z() / 2 - half(v, tv, -o.offset)) / 2);
    put("wall_height_mm", height);
    const double beside_u = o.size.x() / 2 - half(u, tu, height / 2 - o.offset),
                 beside_v = o.size.z() / 2 - half(v, tv, height / 2 - o.offset);
    for (const char* name : {"mesial", "distal"})
      put(std::string("axial_reduction_mm.") + name, beside_u);
    for (const char* name : {"buccal", "lingual"})
      put(std::string("axial_reduction_mm.") + name, beside_v);
  }
  double depth = 0, area = 0;
  const Plan s = stump_plan(o);
  if (s.round > 0 && tu < 0) {
    // The wall's outline in plan times its height along the wall.
    const double r = half(s.round, tu, height / 2 - o.offset);
    area = (4 * (s.half_u + s.half_v) + 2 * units::kPi * r) * height * std::hypot(1, tu);
    depth = -height * tu;
  } else if (s.round == 0) {
    if (tu < 0) area += 4 * half(s.half_v, tv, height / 2 - o.offset) * height * std::hypot(1, tu);
    if (tv < 0) area += 4 * half(s.half_u, tu, height / 2 - o.offset) * height * std::hypot(1, tv);
    depth = std::max({0.0, -height * tu, -height * tv});
  }
  add_undercut({depth, area}, tu >= 0 && tv >= 0, true, truth);
  if (o.pulp_depth) {
    const double distance =
        std::min(*o.pulp_depth - o.occlusal_reduction, stump_wall_to_pulp(o)) - o.offset;
    put("remaining_dentin_min_mm", std::max(0.0, distance));
    put("pulp_exposed", distance <= 0);
  }
}

}  // namespace

CavityTruth cavity_truth(const CavityOptions& options) {
  check_cavity(options);
  CavityTruth truth;
  add_volumes(options, truth);
  if (options.kind == CavityKind::kStump)
    add_stump(options, truth);
  else
    add_box(options, truth);
  return truth;
}

}  // namespace toothprep
