#include "toothprep/proof/specimen/cavity.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <mutex>

#include "toothprep/proof/specimen/block.h"
#include "toothprep/proof/specimen/cavity_shape.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

std::string number(double value) { return fmt::format("{:.4g}", value); }

[[noreturn]] void refuse(const std::string& condition) { throw Error("cavity: " + condition); }

void in_range(const char* name, double value, double low, double high, const char* unit) {
  if (!(value >= low && value <= high))
    refuse(std::string(name) + " must lie between " + number(low) + " and " + number(high) + " " +
           unit + ", got " + number(value));
}

// Strictly between, for angles.
void angle(const char* name, double value, double low, double high) {
  if (!(value > low && value < high))
    refuse(std::string(name) + " must lie between " + number(low) + " and " + number(high) +
           " deg (these not included), got " + number(value));
}

constexpr double kLeastGap = 0.05;  // mm between opposite walls, and of floor below the margin

void check_tooth(const CavityOptions& o) {
  for (const int axis : {0, 1, 2}) in_range("the tooth's size", o.size[axis], 1, 50, "mm");
  in_range("the voxel size", o.voxel, 0.02, 0.5, "mm");
  in_range("the tooth's corner radius", o.corner, 0, std::min(o.size.x(), o.size.z()) / 2, "mm");
  in_range("the enamel", o.enamel, 0, o.size.y(), "mm");
  if (!o.pose.position.allFinite() || !(std::abs(o.pose.orientation.norm() - 1) < 1e-9))
    refuse("the pose needs a finite position and a unit quaternion");
  in_range("the offset", o.offset, 0, 1, "mm");
  if (o.pulp_depth) {
    for (const int axis : {0, 1, 2}) in_range("the pulp's size", o.pulp_size[axis], 0.1, 50, "mm");
    if (!(*o.pulp_depth >= o.enamel))
      refuse("the pulp must lie below the enamel: its depth must be at least " + number(o.enamel) +
             " mm, got " + number(*o.pulp_depth));
    const Plan plan = tooth_plan(o);
    const double q =
        rectangle_distance(o.pulp_size.x() / 2, o.pulp_size.z() / 2, plan.half_u, plan.half_v) -
        plan.round;
    if (!(*o.pulp_depth + o.pulp_size.y() < o.size.y()) || !(q < 0))
      refuse("the pulp must lie inside the tooth");
  }
  if (o.neighbour_gap) in_range("the gap to the neighbour", *o.neighbour_gap, 0.01, 5, "mm");
  in_range("the neighbour's damage", o.neighbour_damage, 0, o.size.x() / 2, "mm");
  if (o.neighbour_damage > 0) {
    if (!o.neighbour_gap) refuse("damage to a neighbour needs a neighbour (a gap)");
    if (o.kind != CavityKind::kClass2) refuse("only a class II box can damage the neighbour");
    if (o.offset > 0) refuse("damage to the neighbour together with an offset is not offered");
  }
}

// Opposite walls, `apart` on the level -depth, must not meet between the levels low and 0.
void check_apart(const char* what, double apart, double level, double taper_a, double taper_b,
                 double low) {
  const double slope = tan_degree(taper_a) + tan_degree(taper_b);
  for (const double w : {low, 0.0})
    if (!(apart + (w - level) * slope > kLeastGap))
      refuse(std::string("the ") + what + " walls meet " +
             (w == 0 ? "below the margin" : "above the floor") +
             "; make the cavity larger there, " + "or less deep, or their tapers smaller");
}

void check_box(const CavityOptions& o) {
  in_range("the length", o.length, 0.1, 50, "mm");
  in_range("the width", o.width, 0.1, 50, "mm");
  in_range("the depth", o.depth, 0.1, 50, "mm");
  angle("taper u+", o.taper_u_plus, -30, 45);
  angle("taper u-", o.taper_u_minus, -30, 45);
  angle("taper v+", o.taper_v_plus, -30, 45);
  angle("taper v-", o.taper_v_minus, -30, 45);
  angle("the floor's tilt along u", o.floor_tilt_u, -30, 30);
  angle("the floor's tilt along v", o.floor_tilt_v, -30, 30);
  in_range("the floor's bow", o.bow, -5, 5, "mm");
  const bool class2 = o.kind == CavityKind::kClass2;
  double low = 0, high = 0;  // the floor's lowest and highest level
  if (o.bow != 0) {
    if (std::abs(o.bow) < 1e-6) refuse("a floor's bow must be zero or at least 1e-6 mm");
    if (o.floor_tilt_u != 0 || o.floor_tilt_v != 0 || o.offset > 0 || class2)
      refuse("a bowed floor together with a tilt, an offset or a class II box is not offered");
    const FloorEnds ends = bowed_floor_ends(o);
    if (!std::isfinite(ends.low) || !std::isfinite(ends.high))
      refuse("the bowed floor never meets the end walls; make its bow or their taper smaller");
    const double at_ends[] = {floor_height(o, ends.low, 0), floor_height(o, ends.high, 0)};
    low = std::min({-o.depth, at_ends[0], at_ends[1]});
    high = std::max({-o.depth, at_ends[0], at_ends[1]});
  } else {
    CavityOptions nominal = o;
    nominal.offset = 0;
    const std::vector<Vec3> floor = flat_floor(nominal);
    if (floor.size() < 3) refuse("the walls meet above the floor");
    low = high = floor[0].z();
    for (const Vec3& corner : floor) {
      low = std::min(low, corner.z());
      high = std::max(high, corner.z());
    }
  }
  if (!(high < -kLeastGap)) refuse("the floor must lie below the margin everywhere");
  if (!class2) check_apart("end (u)", o.length, -o.depth, o.taper_u_plus, o.taper_u_minus, low);
  check_apart("side (v)", o.width, -o.depth, o.taper_v_plus, o.taper_v_minus, low);
  if (class2) {
    if (o.corner > 0) refuse("a class II cavity needs a tooth with a flat side (no corner radius)");
    in_range("the proximal width", o.proximal_width, 0.1, 50, "mm");
    in_range("the axial depth", o.axial_depth, 0.1, o.size.x() - kLeastGap, "mm");
    angle("the axial wall's taper", o.axial_taper, -30, 45);
    angle("the proximal taper", o.proximal_taper, -30, 45);
    if (!(-o.gingival_depth < low - kLeastGap))
      refuse("the gingival floor must lie below the pulpal floor; make its depth more than " +
             number(-low));
    check_apart("proximal", o.proximal_width, -o.gingival_depth, o.proximal_taper, o.proximal_taper,
                -o.gingival_depth);
    for (const double w : {low, 0.0}) {
      const double box =
          o.proximal_width / 2 + (w + o.gingival_depth) * tan_degree(o.proximal_taper);
      const double isthmus =
          o.width / 2 + (w + o.depth) * tan_degree(std::max(o.taper_v_plus, o.taper_v_minus));
      if (!(box >= isthmus - 1e-9))
        refuse("the proximal box must be at least as wide as the isthmus at every level");
    }
    const double axial_top =
        o.size.x() / 2 - o.axial_depth - o.gingival_depth * tan_degree(o.axial_taper);
    if (!(axial_top < o.size.x() / 2 - kLeastGap))
      refuse("the axial wall leaves the tooth's side below the margin");
    low = -o.gingival_depth;
  }
  // Every corner inside the tooth; the open side of a class II box excepted.
  const Plan plan = tooth_plan(o);
  for (ConvexPolyhedron part : cavity_parts(o, side_end(o))) {
    part = clipped(clipped(part, {Vec3::UnitZ(), 0}), {-Vec3::UnitZ(), -low});
    for (const PolyhedronFace& face : part.faces)
      for (const Vec3& corner : face.corners) {
        const double u = class2 ? std::min(corner.x(), 0.0) : corner.x();
        const double inside =
            plan.round - rectangle_distance(u, corner.y(), plan.half_u, plan.half_v);
        if (!(inside > o.offset + 1e-6) || !(corner.z() - o.offset > -o.size.y() + 1e-6))
          refuse("the cavity must lie inside the tooth; it reaches u = " + number(corner.x()) +
                 ", v = " + number(corner.y()) + ", w = " + number(corner.z()) + " mm");
      }
  }
  if (o.bow != 0 && o.pulp_depth && !(-*o.pulp_depth < low))
    refuse("a bowed floor that reaches the pulp is not offered; the pulp must lie deeper than " +
           number(-low) + " mm");
}

void check_stump(const CavityOptions& o) {
  in_range("the occlusal reduction", o.occlusal_reduction, 0, 50, "mm");
  in_range("the shoulder's level", o.shoulder_level, 0.1, 50, "mm");
  in_range("the shoulder's width", o.shoulder_width, 0.05, 50, "mm");
  angle("the convergence in u", o.convergence_u, -30, 60);
  angle("the convergence in v", o.convergence_v, -30, 60);
  if (o.stump_corner) in_range("the stump's corner radius", *o.stump_corner, 0, 50, "mm");
  const double height = o.shoulder_level - o.occlusal_reduction;
  if (!(height > kLeastGap)) refuse("the shoulder must lie below the stump's top");
  in_range("the radius of the top's edge", o.occlusal_radius, 0, 5, "mm");
  in_range("the radius of the shoulder's line angle", o.shoulder_radius, 0, 5, "mm");
  in_range("the shoulder's slope", o.shoulder_slope, 0, 74, "deg");
  if (has_shaped_profile(o)) {
    if (o.offset > 0 || o.pulp_depth)
      refuse("a rounded or sloping stump together with an offset or a pulp is not offered");
    if (!(o.occlusal_radius + o.shoulder_radius < height))
      refuse("the radii of a stump's top and shoulder must be less than its height together");
    if (!(o.shoulder_level + o.shoulder_width * tan_degree(o.shoulder_slope) < o.size.y()))
      refuse("the shoulder's slope reaches the tooth's bottom");
  }
  if (!(o.shoulder_level + o.offset < o.size.y()))
    refuse("the shoulder must lie above the tooth's bottom");
  const Plan stump = stump_plan(o), tooth = tooth_plan(o);
  if (!(std::min(stump.half_u, stump.half_v) >= -1e-12))
    refuse(
        "the stump's corner radius is more than half its side, or the shoulder is wider than "
        "the tooth");
  if (stump.round > 0 && o.convergence_u != o.convergence_v)
    refuse("a stump with rounded corners needs the same convergence in u and v");
  const double out = rectangle_distance(stump.half_u, stump.half_v, tooth.half_u, tooth.half_v) -
                     tooth.round + stump.round;
  const double grown = std::max(
      {0.0, -height * tan_degree(o.convergence_u / 2), -height * tan_degree(o.convergence_v / 2)});
  if (!(out + grown < -1e-9))
    refuse(
        "the stump must lie inside the tooth's outline up to its top; widen the shoulder or "
        "round the stump's corners");
  const auto top = [&](double at_shoulder, double convergence) {
    const double t = tan_degree(convergence / 2);
    return at_shoulder - height * std::max(t, 0.0) - o.offset * std::hypot(1, t);
  };
  const bool meet =
      stump.round > 0
          ? top(stump.round, o.convergence_u) < 0 ||
                std::min(stump.half_u, stump.half_v) + top(stump.round, o.convergence_u) < kLeastGap
          : top(stump.half_u, o.convergence_u) < kLeastGap ||
                top(stump.half_v, o.convergence_v) < kLeastGap;
  if (!(o.occlusal_radius <=
        top(stump.round > 0 ? stump.round : std::min(stump.half_u, stump.half_v),
            std::max(o.convergence_u, o.convergence_v))))
    refuse("the radius of the stump's top edge must be at most that of its corners there");
  if (meet)
    refuse(
        "the stump's walls (or its rounded corners) meet below its top; make the convergence "
        "or the height smaller, or the corner radius larger");
  if (o.pulp_depth && !(stump_wall_to_pulp(o) > o.offset))
    refuse("a stump whose walls cut the pulp is not offered; make the pulp narrower");
}

std::string text_of(const Vec3& v) {
  return fmt::format("{:.12g} {:.12g} {:.12g}", v.x() + 0.0, v.y() + 0.0, v.z() + 0.0);
}

// What stands in W before the cavity, as distances at a point of the frame (u, v, w).
struct Bodies {
  explicit Bodies(const CavityOptions& options) : o(options) {
    const Vec3 half(o.pulp_size.x() / 2, o.pulp_size.z() / 2, 0);
    if (o.pulp_depth) {
      pulp_low = -half - Vec3(0, 0, *o.pulp_depth + o.pulp_size.y());
      pulp_high = half - Vec3(0, 0, *o.pulp_depth);
    }
    if (o.neighbour_gap) {
      const double start = o.size.x() / 2 + *o.neighbour_gap;
      neighbour_low = {start, -o.size.z() / 2, -o.size.y()};
      neighbour_high = {start + o.size.x(), o.size.z() / 2, 0};
    }
  }
  double tooth(const Vec3& p) const { return tooth_distance(o, p); }
  double neighbour(const Vec3& p) const {
    return o.neighbour_gap ? box_distance(p, neighbour_low, neighbour_high) : kNone;
  }
  double pulp(const Vec3& p) const {
    return o.pulp_depth ? box_distance(p, pulp_low, pulp_high) : kNone;
  }
  ToothSample sample(const Vec3& p) const {
    const double t = tooth(p), n = neighbour(p), inner = pulp(p), above = -o.enamel - p.z();
    ToothSample s;
    s.solid = static_cast<float>(std::min(t, n));
    s.tissue = {static_cast<float>(o.enamel > 0 ? std::max(t, above) : kNone),
                static_cast<float>(o.enamel < o.size.y() ? std::max({t, -above, -inner}) : kNone),
                static_cast<float>(inner)};
    if (t < 0) {
      // A centre that lies on the border to rounding belongs to the enamel.
      s.label = above < 1e-9 && o.enamel > 0 ? Tissue::kEnamel
                : inner < 0                  ? Tissue::kPulp
                                             : Tissue::kDentin;
    } else if (n < 0) {
      s.label = Tissue::kOther;
    }
    return s;
  }

  static constexpr double kNone = 1e3;
  const CavityOptions& o;
  Vec3 pulp_low = Vec3::Zero(), pulp_high = Vec3::Zero();
  Vec3 neighbour_low = Vec3::Zero(), neighbour_high = Vec3::Zero();
};

LayeredTooth make_original(const CavityOptions& o, const Bodies& bodies) {
  const Vec3 low(-o.size.x() / 2, -o.size.y(), -o.size.z() / 2);
  Vec3 high(o.size.x() / 2, 0, o.size.z() / 2);
  if (o.neighbour_gap) high.x() += *o.neighbour_gap + o.size.x();
  const auto [lattice, lower, upper] = grid_of_box(low, high, o.voxel, o.pose);
  return build_tooth(
      lattice, lower, upper, [&](const Vec3& x) { return bodies.sample(uvw(o.pose.to_local(x))); },
      true);
}

const char* name_of(CavityKind kind) {
  return kind == CavityKind::kBox ? "box" : kind == CavityKind::kClass2 ? "class2" : "stump";
}

}  // namespace

void check_cavity(const CavityOptions& options) {
  check_tooth(options);
  if (options.kind == CavityKind::kStump)
    check_stump(options);
  else
    check_box(options);
}

CavitySpecimen make_cavity(const CavityOptions& o) {
  check_cavity(o);
  const Bodies bodies(o);
  CavitySpecimen specimen;
  LayeredTooth& original = specimen.original;
  original = make_original(o, bodies);
  original.provenance["source"] = std::string("specimen cavity ") + name_of(o.kind);
  original.provenance["axis_occlusal"] = text_of(o.pose.orientation * Vec3::UnitY());
  original.provenance["axis_mesial"] = text_of(o.pose.orientation * Vec3::UnitX());
  original.provenance["axis_buccal"] = text_of(o.pose.orientation * -Vec3::UnitZ());
  specimen.prepared = original;

  const CavityShape cavity(o, side_end(o));
  std::optional<CavityShape> damage;
  if (o.neighbour_damage > 0) damage.emplace(o, damage_end(o));
  const double band = original.band();
  const double half_diagonal = o.voxel * (kBrickEdge - 1) / 2.0 * std::sqrt(3.0);
  const auto limit = static_cast<float>(band);
  const auto clamped = [limit](double d) {
    return std::clamp(static_cast<float>(d), -limit, limit);
  };
  LevelSet solid = original.solid;
  LevelSet cut(solid.first_brick(), solid.brick_counts(), -limit, {limit});
  std::mutex insert;
  tbb::parallel_for(std::size_t{0}, solid.table_size(), [&](std::size_t b) {
    const LevelSet& before = original.solid;
    if (before.is_uniform(b) && before.uniform_value(b) > 0) return;  // air stays air
    const Index3 first = before.brick_origin(b);
    const Vec3 middle =
        original.lattice.to_world(first) + Vec3::Constant(o.voxel * (kBrickEdge - 1) / 2.0);
    if (cavity.distance(uvw(o.pose.to_local(middle))) > half_diagonal + band) return;
    std::array<float, kBrickVoxels> next, carved;
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Index3 i = first + Index3(v >> 6, (v >> 3) & 7, v & 7);
      const Vec3 p = uvw(o.pose.to_local(original.lattice.to_world(i)));
      // The cavity cuts the tooth; the neighbour only as far as it is damaged.
      carved[v] = clamped(-cavity.distance(p));
      const double tooth = std::max(bodies.tooth(p), -cavity.distance(p));
      const double neighbour =
          damage ? std::max(bodies.neighbour(p), -damage->distance(p)) : bodies.neighbour(p);
      next[v] = clamped(std::min(tooth, neighbour));
    }
    const std::lock_guard lock(insert);
    solid.set_brick(b, next.data());
    cut.set_brick(b, carved.data());
  });
  if (o.neighbour_gap)  // the cavity may reach into the neighbour, which it doesn't cut
    apply_remaining_solid(specimen.prepared, std::move(solid));
  else
    apply_cut(specimen.prepared, cut);
  return specimen;
}

std::function<double(const Vec3&)> cavity_distance(const CavityOptions& options) {
  check_cavity(options);
  return [shape = CavityShape(options, side_end(options)), pose = options.pose](const Vec3& x) {
    return shape.distance(uvw(pose.to_local(x)));
  };
}

std::optional<double> truth_value(const CavityTruth& truth, const std::string& key) {
  for (const TruthFigure& figure : truth)
    if (figure.key == key) return figure.value;
  return std::nullopt;
}

}  // namespace toothprep
