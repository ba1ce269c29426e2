#include "toothprep/tools/preparation/preparation.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/number_text.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/compare/cut_surface.h"
#include "toothprep/tools/mesh/sharp_surface.h"
#include "toothprep/tools/preparation/cut_facets.h"
#include "toothprep/tools/preparation/floors.h"
#include "toothprep/tools/preparation/frame.h"
#include "toothprep/tools/preparation/profile.h"
#include "toothprep/tools/preparation/texture.h"
#include "toothprep/tools/preparation/undercut.h"
#include "toothprep/tools/preparation/walls.h"

namespace toothprep {
namespace {

constexpr double kDegree = units::from_degree(1);
constexpr std::size_t kFewestFacets = 30;

// What all measurements read, and the preparation that they fill.
struct Bench {
  const LayeredTooth &original, &prepared;
  const TriangleMesh& surface;
  const PreparationOptions& options;
  const CutFacets& facets;
  const TriangleMesh& original_surface;
  const TriangleTree& original_tree;
  const TriangleTree& tree;
  double tolerance = 0;  // mm, of what counts as cut
  std::vector<Floor> floors;
  std::vector<WallFacet> walls;
  Preparation result;

  const PreparationFrame& frame() const { return result.frame; }
  double voxel() const { return original.lattice.voxel; }
  // What the cut surface is known to, mm. Both ends of a length may lie half a label off.
  double resolution() const { return std::max(voxel(), options.cut_label_spacing); }
  double length_uncertainty() const {
    return std::max({voxel() / 2, options.cut_label_spacing, options.original_label_spacing / 2,
                     std::sqrt(2.0) * options.cut_half_width});
  }
  void add(const std::string& key, double value, double uncertainty, const char* unit) {
    if (std::isfinite(value)) result.quantities.push_back({key, value, uncertainty, unit});
  }
  void add_length(const std::string& key, double value) {
    add(key, value, length_uncertainty(), "mm");
  }
  void note(const std::string& text) { result.notes.push_back(text); }
};

// Of a face of that length. In labels a wall can lie straight between two steps, and is measured to a quarter
// of a voxel besides.
double angle_uncertainty(const Bench& bench, double span) {
  const double steps = bench.options.cut_label_spacing;
  const double across =
      steps > 0 ? std::max(bench.voxel(), steps + bench.voxel() / 4) : bench.voxel();
  return std::atan(across / span) / kDegree;
}

// Of the sum of two opposite walls' angles. Labels err alike on both sides.
double angle_uncertainty(const Bench& bench, double span, double opposite_span) {
  const double a = angle_uncertainty(bench, span), b = angle_uncertainty(bench, opposite_span);
  return bench.options.cut_label_spacing > 0 ? a + b : std::hypot(a, b);
}

// Of an arc between two sides at that angle (degrees), from the gap between arc and corner, which is
// 0.41 of the radius at a right angle and less at a wider one. Voxels bevel the corner by up to half
// of them. Sides that may each stand off their place, as those of labels and scans, move it too.
double radius_uncertainty(const Bench& bench, double angle_deg) {
  const double sine = std::sin(angle_deg * kDegree / 2), share = 1 / sine - 1;
  const double aside = std::max(bench.options.cut_tolerance, bench.options.cut_label_spacing / 2);
  return std::max(bench.resolution(), (0.5 * bench.voxel() + aside / sine) / share);
}

std::string text_of(double value, fmt::format_string<double> format) {
  return without_negative_zero(fmt::vformat(format, fmt::make_format_args(value)));
}

Wall wall_on(const Bench& bench, Side side, const std::vector<WallFacet>& walls) {
  return wall_of(walls, side, bench.facets, bench.frame(), bench.options.type);
}

// The mean distance between two opposing walls at a height; NaN if one is missing.
double distance_between(const Wall& a, const Wall& b, double height) {
  if (a.middle.empty() || b.middle.empty()) return NAN;
  return a.distance_at(height) + b.distance_at(height);
}

// Where the facets of a wall's middle third would be at another height, along the wall's slope:
// distance from the origin to the wall's side.
double shifted_distance(const Bench& bench, const Wall& wall, const WallFacet& w, double height) {
  const Vec3& c = bench.facets[w.facet].centroid;
  const double lean = std::tan(wall.angle_deg * kDegree) * (wall.cavity ? 1 : -1);
  return (c - bench.frame().origin).dot(outward(wall.side, bench.frame())) +
         lean * (height - bench.frame().height(c));
}

// The outermost place of a wall at a height: what 98 % of its area stays within.
double extent(const Bench& bench, const Wall& wall, double height) {
  Weighted places;
  for (const WallFacet& w : wall.middle)
    places.add(shifted_distance(bench, wall, w, height), bench.facets[w.facet].area);
  return places.quantile(0.98);
}

// Smallest distance between the two walls along the form, in slices two voxels wide. Only facets
// that face across the form within 30° count: its rounded ends are narrower everywhere.
double narrowest(const Bench& bench, const Wall& a, const Wall& b, double height) {
  const PreparationFrame& frame = bench.frame();
  const Vec3 along = std::abs(outward(a.side, frame).dot(frame.u)) > 0.5 ? frame.v : frame.u;
  const double slice = 2 * bench.voxel();
  struct Sum {
    double area = 0, distance = 0;
  };
  std::map<int, std::array<Sum, 2>> slices;
  for (int k = 0; k < 2; ++k) {
    const Wall& wall = k == 0 ? a : b;
    for (const WallFacet& w : wall.middle) {
      const Facet& f = bench.facets[w.facet];
      const Vec3 flat = f.normal - f.normal.dot(frame.d) * frame.d;
      if (std::abs(flat.normalized().dot(outward(wall.side, frame))) < std::cos(30 * kDegree))
        continue;
      const int n = static_cast<int>(std::floor((f.centroid - frame.origin).dot(along) / slice));
      Sum& sum = slices[n][k];
      sum.area += f.area;
      sum.distance += f.area * shifted_distance(bench, wall, w, height);
    }
  }
  double least = NAN;
  const double enough = slice * bench.voxel();
  for (const auto& [n, sums] : slices) {
    if (sums[0].area < enough || sums[1].area < enough) continue;
    const double width = sums[0].distance / sums[0].area + sums[1].distance / sums[1].area;
    if (!(width >= least)) least = width;
  }
  return least;
}

// Angles of four walls and what opposing ones make of it.
void add_angles(Bench& bench, const std::array<Wall, 4>& walls) {
  for (const Wall& wall : walls)
    if (!wall.middle.empty())
      bench.add("wall_angles_deg." + side_name(wall.side, bench.frame()), wall.angle_deg,
                angle_uncertainty(bench, wall.height), "deg");
  const bool crown = bench.options.type == PreparationType::kCrown;
  double sum = 0, all = 0, variance = 0;  // labels err alike on all sides
  int count = 0;
  for (const Side side : {Side::kBuccal, Side::kMesial}) {
    const Wall& a = walls[static_cast<int>(side)];
    const Wall& b = walls[static_cast<int>(opposite(side))];
    if (a.middle.empty() || b.middle.empty()) continue;
    const double both = (a.angle_deg + b.angle_deg) * (crown ? 1 : -1);
    const double uncertainty = angle_uncertainty(bench, a.height, b.height);
    bench.add(
        std::string("convergence_deg.") + (side == Side::kBuccal ? "buccolingual" : "mesiodistal"),
        both, uncertainty, "deg");
    sum += both;
    all += uncertainty;
    variance += uncertainty * uncertainty;
    ++count;
  }
  if (bench.options.cut_label_spacing <= 0) all = std::sqrt(variance);
  if (count > 0) bench.add("convergence_deg.mean", sum / count, all / count, "deg");
}

std::array<Wall, 4> four_walls(const Bench& bench, const std::vector<WallFacet>& facets) {
  return {wall_on(bench, Side::kMesial, facets), wall_on(bench, Side::kDistal, facets),
          wall_on(bench, Side::kBuccal, facets), wall_on(bench, Side::kLingual, facets)};
}

void add_wall_height(Bench& bench, const std::vector<WallFacet>& walls) {
  Weighted heights;
  for (const WallFacet& w : walls) {
    const Facet& f = bench.facets[w.facet];
    const double up = f.normal.dot(bench.frame().d);
    heights.add((w.foot + w.rim) * std::sqrt(1 - up * up), f.area);
  }
  bench.add_length("wall_height_mm", heights.quantile(0.5));
}

void add_floor(Bench& bench, const Floor& floor, const std::string& prefix) {
  const double uncertainty = angle_uncertainty(bench, std::sqrt(floor.area));
  bench.add_length(prefix + "floor_flatness_mm", floor.flatness);
  bench.add(prefix + "floor_tilt_deg", floor.plane.tilt_deg(), uncertainty, "deg");
}

// A surface that faces less upwards than this (45°) is the tooth's side and no slope of a ridge.
constexpr double kProximal = 0.7071;

// What is left around a cavity: ridges towards the neighbours, and the thinnest wall.
void add_remaining_walls(Bench& bench, const std::vector<WallFacet>& walls) {
  const PreparationFrame& frame = bench.frame();
  const double off = bench.voxel();  // into the tooth, off the wall that the way starts from
  std::array<Weighted, 4> ridges;
  Weighted thickness;
  for (const WallFacet& w : walls) {
    const Facet& f = bench.facets[w.facet];
    const double at = w.foot / (w.foot + w.rim);
    if (at < 1.0 / 3 || !w.plain) continue;
    const bool along = w.side == Side::kMesial || w.side == Side::kDistal;
    const Vec3 out = outward(w.side, frame);
    if (along && at > 2.0 / 3)
      if (const auto hit = bench.original_tree.first_hit(f.centroid, out);
          hit && bench.original_tree.normal(hit->triangle).dot(frame.d) < kProximal)
        ridges[static_cast<std::size_t>(w.side)].add(hit->distance, f.area);
    const Vec3 into = -(f.normal - f.normal.dot(frame.d) * frame.d).normalized();
    if (at < 2.0 / 3)
      if (const auto hit = bench.tree.first_hit(f.centroid + off * into, into))
        thickness.add(hit->distance + off, f.area);
  }
  for (const Side side : {Side::kMesial, Side::kDistal})
    bench.add_length("marginal_ridge_mm." + side_name(side, frame),
                     ridges[static_cast<std::size_t>(side)].quantile(0.25));
  bench.add_length("wall_thickness_min_mm", thickness.quantile(0.02));
}

// Whether a class I cavity comes out at the tooth's side: a finish line of 1 mm and more in all
// where the original's surface is within 10° of upright.
void add_breakthrough(Bench& bench) {
  double length = 0;
  for (const FinishSegment& s : bench.facets.finish_line()) {
    const auto nearest = bench.original_tree.nearest(s.middle);
    if (bench.original_tree.normal(nearest.triangle).dot(bench.frame().d) < std::sin(10 * kDegree))
      length += s.length;
  }
  bench.add("breakthrough", length > 1 ? 1 : 0, NAN, "yes/no");
}

// Depth, floor, walls and widths of a cavity, or of the occlusal part of a class II.
// Returns the median depth.
double measure_cavity(Bench& bench, const Floor& floor, const std::vector<WallFacet>& walls) {
  Weighted depths = depths_below(floor.facets, bench.facets, bench.frame(), bench.original_tree);
  if (depths.empty())
    throw Error(
        "the floor doesn't lie below the original's surface along the occlusal axis; is "
        "the axis right?");
  const double depth = depths.quantile(0.5);
  bench.add_length("depth_mm", depth);
  bench.add_length("depth_min_mm", depths.quantile(0.05));
  bench.add_length("depth_max_mm", depths.quantile(0.95));
  add_floor(bench, floor, "");
  const std::array<Wall, 4> sides = four_walls(bench, walls);
  add_angles(bench, sides);
  add_wall_height(bench, walls);
  const double half = floor.plane.level + depth / 2;
  const auto across = [&](Side side) {
    const Wall& a = sides[static_cast<int>(side)];
    const Wall& b = sides[static_cast<int>(opposite(side))];
    return a.middle.empty() || b.middle.empty() ? NAN
                                                : extent(bench, a, half) + extent(bench, b, half);
  };
  bench.add_length("width_mm", across(Side::kBuccal));
  bench.add_length("isthmus_width_mm", narrowest(bench, sides[static_cast<int>(Side::kBuccal)],
                                                 sides[static_cast<int>(Side::kLingual)], half));
  bench.add_length("length_mm", across(Side::kMesial));
  return depth;
}

constexpr auto kOther = static_cast<std::uint8_t>(Tissue::kOther);

// In a tooth with tissues `other` is a neighbour; a bare mesh is `other` throughout.
bool has_tissues(const TriangleMesh& surface) {
  return std::any_of(surface.tissue.begin(), surface.tissue.end(), [](std::uint8_t label) {
    return label == static_cast<std::uint8_t>(Tissue::kEnamel) ||
           label == static_cast<std::uint8_t>(Tissue::kDentin);
  });
}

// The triangles of a surface all of whose corners bear `other`, or those that remain without them,
// as a mesh of their own.
TriangleMesh triangles_of(const TriangleMesh& surface, bool other) {
  TriangleMesh part;
  part.vertices = surface.vertices;
  part.tissue = surface.tissue;
  for (const auto& t : surface.triangles)
    if (other == std::all_of(t.begin(), t.end(),
                             [&](std::uint32_t v) { return surface.tissue[v] == kOther; }))
      part.triangles.push_back(t);
  return part;
}

// How near the finish line comes to a neighbouring tooth below that height.
void add_box_clearance(Bench& bench, double below) {
  const TriangleMesh neighbour = has_tissues(bench.original_surface)
                                     ? triangles_of(bench.original_surface, true)
                                     : TriangleMesh{};
  if (neighbour.triangles.empty()) return;
  const TriangleTree tree(neighbour);
  double least = NAN;
  for (const FinishSegment& s : bench.facets.finish_line()) {
    if (bench.frame().height(s.middle) > below) continue;
    const double distance = tree.nearest(s.middle).distance;
    if (!(distance >= least)) least = distance;
  }
  bench.add_length("box_clearance_mm", least);
}

// How far the axial wall stands within the proximal surface, half-way between the floors and at the
// gingival floor, and the edge above it. Beside the isthmus the wall goes on to the margin.
void add_axial_wall(Bench& bench, const std::vector<WallFacet>& box, const Wall& axial,
                    const Floor& floor, double step) {
  const PreparationFrame& frame = bench.frame();
  const Vec3 out = -outward(axial.side, frame);
  const double lean = std::tan(axial.angle_deg * kDegree);
  Weighted reach, at_floor;
  std::vector<MarginStation> stations;
  for (const WallFacet& w : box) {
    const Facet& f = bench.facets[w.facet];
    const double height = frame.height(f.centroid) - floor.plane.level;
    if (w.side != axial.side || !w.plain || std::abs(height / step - 0.5) > 1.0 / 6) continue;
    if (const auto hit = bench.original_tree.first_hit(f.centroid, out))
      reach.add(hit->distance, f.area);
    const Vec3 foot = f.centroid - height * frame.d + height * lean * out;
    if (const auto hit = bench.original_tree.first_hit(foot, out))
      at_floor.add(hit->distance, f.area);
    const Vec3 across = (f.normal - f.normal.dot(frame.d) * frame.d).normalized();
    stations.push_back({f.centroid, across, f.normal, 0});
  }
  bench.add_length("axial_depth_mm", reach.quantile(0.5));
  bench.add_length("gingival_floor_width_mm", at_floor.quantile(0.5));
  constexpr std::size_t kPlaces = 40;
  std::vector<MarginStation> some;
  for (std::size_t n = 0; n < stations.size(); n += stations.size() / kPlaces + 1)
    some.push_back(stations[n]);
  const OuterEdge edge =
      measure_outer_edge(some, bench.facets, frame, bench.tree, step, bench.voxel());
  bench.add("axiopulpal_radius_mm", edge.radius.quantile(0.5),
            radius_uncertainty(bench, edge.angle.quantile(0.5)), "mm");
}

// The walls that stand on a gingival floor, by their sides.
struct Box {
  std::vector<WallFacet> facets;
  std::array<Wall, 4> sides;
  Side open = Side::kMesial;

  Box(const Bench& bench, int gingival) {
    for (const WallFacet& w : bench.walls)
      if (w.floor == gingival) facets.push_back(w);
    sides = four_walls(bench, facets);
    // It is open where it has least wall, mesially or distally or at the side.
    for (const Wall& wall : sides)
      if (wall.area < sides[static_cast<int>(open)].area) open = wall.side;
  }
  const Wall& axial() const { return sides[static_cast<int>(opposite(open))]; }
};

void measure_box(Bench& bench, const Box& box, int gingival, int pulpal) {
  const PreparationFrame& frame = bench.frame();
  const Floor& floor = bench.floors[gingival];
  const std::array<Wall, 4>& sides = box.sides;
  const Wall& axial = box.axial();

  Weighted depths = depths_below(floor.facets, bench.facets, frame, bench.original_tree);
  bench.add_length("gingival_depth_mm", depths.quantile(0.5));
  const double step =
      bench.floors[pulpal].plane.height_at(floor.plane.centre.x(), floor.plane.centre.y()) -
      floor.plane.level;
  bench.add_length("axial_wall_height_mm", step);
  add_floor(bench, floor, "gingival_");
  for (const Wall& wall : sides) {
    if (wall.middle.empty() || wall.side == box.open) continue;
    bench.add("wall_angles_deg." + (&wall == &axial ? std::string("axial")
                                                    : "proximal_" + side_name(wall.side, frame)),
              wall.angle_deg, angle_uncertainty(bench, wall.height), "deg");
  }
  add_axial_wall(bench, box.facets, axial, floor, step);
  const bool lengthwise = std::abs(outward(box.open, frame).dot(frame.u)) > 0.5;
  const Wall& a = sides[static_cast<int>(lengthwise ? Side::kBuccal : Side::kMesial)];
  const Wall& b = sides[static_cast<int>(opposite(a.side))];
  bench.add_length("box_width_mm", distance_between(a, b, (a.level + b.level) / 2));
  bench.add_length("box_width_floor_mm", distance_between(a, b, floor.plane.level));
  if (!a.middle.empty() && !b.middle.empty())
    bench.add("convergence_deg.proximal", -(a.angle_deg + b.angle_deg),
              angle_uncertainty(bench, a.height, b.height), "deg");
  add_box_clearance(bench, bench.floors[pulpal].plane.level);
}

constexpr double kStepHeight = 0.3;  // mm, at least, between two floors of a class II

// The two floors of a class II by their index: the lowest of some size, and the largest that lies
// at least 0.3 mm above it; -1 where there is none.
struct Step {
  int gingival = -1, pulpal = -1;
};
Step find_step(const std::vector<Floor>& floors) {
  double total = 0;
  for (const Floor& floor : floors) total += floor.area;
  Step step;
  for (std::size_t n = 0; n < floors.size(); ++n)
    if (floors[n].area > 0.08 * total &&
        (step.gingival < 0 || floors[n].plane.level < floors[step.gingival].plane.level))
      step.gingival = static_cast<int>(n);
  for (std::size_t n = 0; n < floors.size(); ++n)
    if (step.pulpal < 0 && floors[n].area > 0.08 * total &&
        floors[n].plane.level > floors[step.gingival].plane.level + kStepHeight)
      step.pulpal = static_cast<int>(n);
  return step;
}

// The walls beside the pulpal floor. Beside the axial wall a blurred scan joins them with the box's,
// whose way down may then end on the axial wall; so what lies beyond it, or within two voxels, is not
// the occlusal part's.
std::vector<WallFacet> occlusal_walls(const Bench& bench, const Box& box, int pulpal) {
  const PreparationFrame& frame = bench.frame();
  const Wall& axial = box.axial();
  const Vec3 into = outward(axial.side, frame);
  std::vector<WallFacet> occlusal;
  for (const WallFacet& w : bench.walls) {
    if (w.floor >= 0 &&
        bench.floors[w.floor].plane.level < bench.floors[pulpal].plane.level - kStepHeight)
      continue;
    const Vec3& c = bench.facets[w.facet].centroid;
    if (!axial.middle.empty() &&
        (c - frame.origin).dot(into) < axial.distance_at(frame.height(c)) + 2 * bench.voxel())
      continue;
    occlusal.push_back(w);
  }
  return occlusal;
}

void measure_class2(Bench& bench) {
  const auto [gingival, pulpal] = find_step(bench.floors);
  if (pulpal < 0) {
    bench.note(
        "no step of 0.3 mm between two floors was found, so it is measured as one cavity "
        "without a proximal box");
    measure_cavity(bench, bench.floors[0], bench.walls);
    return;
  }
  const Box box(bench, gingival);
  measure_cavity(bench, bench.floors[pulpal], occlusal_walls(bench, box, pulpal));
  measure_box(bench, box, gingival, pulpal);
}

// The margin of a tooth that was cut here.
std::vector<FinishSegment> sharp_finish_line(const LayeredTooth& prepared) {
  const SharpSurface surface = extract_sharp_surface(prepared);
  std::vector<FinishSegment> line;
  for (const auto& edge : surface.margin) {
    const Vec3 a = surface.mesh.vertices[edge[0]].cast<double>(),
               b = surface.mesh.vertices[edge[1]].cast<double>();
    line.push_back({(a + b) / 2, (b - a).norm(), a, b});
  }
  return line;
}

// How often and how far the margin is missing, and on which side.
void add_gaps(Bench& bench, const Margin& margin) {
  double all = 0, longest = 0;
  std::string where;
  for (const MarginGap& gap : margin.gaps) {
    all += gap.angle;
    longest = std::max(longest, gap.length);
    const double u = std::cos(gap.middle), v = std::sin(gap.middle);
    const Side side = std::abs(u) >= std::abs(v) ? (u > 0 ? Side::kMesial : Side::kDistal)
                                                 : (v > 0 ? Side::kBuccal : Side::kLingual);
    where += (where.empty() ? "" : ", ") + side_name(side, bench.frame()) +
             fmt::format(" ({:.2f} mm)", gap.length);
  }
  bench.add("margin_gaps", static_cast<double>(margin.gaps.size()), NAN, "count");
  bench.add("margin_gap_deg", all / kDegree, NAN, "deg");
  bench.add("margin_gap_longest_mm", longest, 2 * bench.length_uncertainty(), "mm");
  if (!where.empty()) bench.note("the margin is interrupted: " + where);
}

// What kind of margin it is, and the edge above the walls.
void add_profiles(Bench& bench, const Margin& margin) {
  const MarginProfiles profiles = measure_profiles(margin, bench.facets, bench.frame(), bench.tree,
                                                   bench.original_tree, bench.voxel());
  for (std::size_t n = 0; n < kMarginForms.size(); ++n)
    bench.add("margin_form." + std::string(kMarginForms[n]), profiles.share[n], NAN, "1");
  // The ledge is straight beyond the arc; of one that is mostly arc, the arc's end counts.
  const double width = margin.width.quantile(0.5), angle_deg = profiles.angle.quantile(0.5);
  const double arc = profiles.radius.quantile(0.5) / std::tan(angle_deg * kDegree / 2);
  bench.add("cavosurface_angle_deg", profiles.cavosurface.quantile(0.5),
            angle_uncertainty(bench, std::max(width - arc, width / 2)), "deg");
  bench.add("line_angle_radius_mm", profiles.radius.quantile(0.5),
            radius_uncertainty(bench, angle_deg), "mm");
  const Quantity* height = find_quantity(bench.result.quantities, "wall_height_mm");
  if (!height) return;
  const OuterEdge edge = measure_outer_edge(margin.stations, bench.facets, bench.frame(),
                                            bench.tree, height->value, bench.voxel());
  if (edge.radius.empty()) return;
  const double angle = edge.angle.quantile(0.5), radius = radius_uncertainty(bench, angle);
  bench.add("occlusoaxial_radius_mm", edge.radius.quantile(0.5), radius, "mm");
  bench.add("occlusoaxial_radius_min_mm", edge.radius.quantile(0.05), radius, "mm");
  bench.add("occlusoaxial_angle_deg", angle, angle_uncertainty(bench, kEdgeReach), "deg");
  bench.add("occlusoaxial_sharp", edge.sharp, NAN, "1");
}

void measure_crown(Bench& bench) {
  const PreparationFrame& frame = bench.frame();
  const std::array<Wall, 4> sides = four_walls(bench, bench.walls);
  Weighted levels;
  for (const Wall& wall : sides)
    if (!wall.middle.empty()) levels.add(wall.level, wall.area);
  if (levels.empty())
    throw Error("no axial wall was found; is this a crown preparation, and is the axis right?");
  add_angles(bench, sides);
  add_wall_height(bench, bench.walls);

  Weighted occlusal;
  const double middle = levels.quantile(0.5);
  for (const Floor& floor : bench.floors)
    if (floor.plane.level > middle)
      for (const std::uint32_t i : floor.core)
        if (const auto hit = bench.original_tree.first_hit(bench.facets[i].centroid, frame.d))
          occlusal.add(hit->distance, bench.facets[i].area);
  if (occlusal.empty()) {
    bench.note("the occlusal surface was not reduced");
    bench.add_length("occlusal_reduction_mm", 0);
    bench.add_length("occlusal_reduction_min_mm", 0);
  } else {
    bench.add_length("occlusal_reduction_mm", occlusal.quantile(0.5));
    bench.add_length("occlusal_reduction_min_mm", occlusal.quantile(0.05));
  }
  Weighted all;
  for (const Wall& wall : sides) {
    Weighted axial;
    for (const WallFacet& w : wall.middle) {
      const Facet& f = bench.facets[w.facet];
      const Vec3 out = (f.normal - f.normal.dot(frame.d) * frame.d).normalized();
      if (const auto hit = bench.original_tree.first_hit(f.centroid, out)) {
        axial.add(hit->distance, f.area);
        all.add(hit->distance, f.area);
      }
    }
    bench.add_length("axial_reduction_mm." + side_name(wall.side, frame), axial.quantile(0.5));
  }
  bench.add_length("axial_reduction_min_mm", all.quantile(0.05));

  const bool sharp = bench.prepared.parts.has_value();
  const Margin margin =
      measure_margin(bench.facets, bench.walls, frame, bench.tolerance, bench.voxel(),
                     sharp ? sharp_finish_line(bench.prepared) : bench.facets.finish_line());
  bench.add_length("margin_width_mm", margin.width.quantile(0.5));
  bench.add_length("margin_width_min_mm", margin.width.quantile(0.05));
  bench.add_length("margin_width_max_mm", margin.width.quantile(0.95));
  bench.add("margin_continuity", margin.continuity, NAN, "1");
  add_gaps(bench, margin);
  add_profiles(bench, margin);
  bench.add(
      "finish_line_roughness_mm", margin.roughness,
      sharp ? bench.voxel() / 10 : std::max(bench.voxel() / 4, bench.options.cut_label_spacing / 2),
      "mm");
}

void measure_draw(Bench& bench) {
  const Vec3& axis = bench.frame().d;
  const Vec3 path = best_path_of_draw(bench.facets, axis);
  bench.result.path_of_draw = path;
  std::vector<double> ways_down(bench.facets.size(), NAN);
  for (const WallFacet& w : bench.walls)
    if (w.foot < 4 * bench.voxel()) ways_down[w.facet] = w.foot;
  const Undercut undercut =
      find_undercuts(bench.facets, bench.tree, path, bench.options.undercut_threshold, ways_down);
  for (const std::uint32_t i : undercut.facets)
    bench.result.undercut_triangles.push_back(bench.facets[i].triangle);
  bench.result.deepest_undercut = undercut.place;
  bench.add_length("undercut_max_mm", undercut.deepest);
  bench.add("undercut_area_mm2", undercut.area, NAN, "mm^2");
  const Undercut along_axis =
      find_undercuts(bench.facets, bench.tree, axis, bench.options.undercut_threshold, ways_down);
  bench.add_length("undercut_along_axis_mm", along_axis.deepest);
  bench.add("path_of_draw_tilt_deg", std::acos(std::clamp(path.dot(axis), -1.0, 1.0)) / kDegree,
            NAN, "deg");
}

void measure_pulp(Bench& bench) {
  const TriangleMesh pulp = extract_surface(bench.original, SurfaceOf::kPulp);
  if (pulp.triangles.empty()) {
    for (const char* key : {"remaining_dentin_min_mm", "pulp_exposed"})
      bench.result.absent.push_back({key, "the original has no pulp"});
    return;
  }
  const TriangleTree tree(pulp);
  std::vector<double> distance(bench.facets.size());
  tbb::parallel_for(std::size_t{0}, distance.size(), [&](std::size_t i) {
    distance[i] = tree.signed_distance(bench.facets[i].centroid);
  });
  const auto least = std::min_element(distance.begin(), distance.end());
  bench.result.thinnest_dentin =
      bench.facets[static_cast<std::size_t>(least - distance.begin())].centroid;
  bench.add_length("remaining_dentin_min_mm", std::max(0.0, *least));
  bench.add("pulp_exposed", *least < -bench.voxel() / 4 ? 1 : 0, NAN, "yes/no");
}

// ---- How well the axis is known

// Angles between walls that face each other don't depend on the axis, nor do distances between
// surfaces.
bool depends_on_axis(const Quantity& q) {
  if (q.unit == "deg")
    return !q.key.starts_with("convergence_deg") && q.key != "cavosurface_angle_deg" &&
           q.key != "occlusoaxial_angle_deg" && q.key != "margin_gap_deg";
  if (q.unit != "mm") return false;
  for (const char* free :
       {"floor_flatness_mm", "gingival_floor_flatness_mm", "undercut_max_mm",
        "remaining_dentin_min_mm", "surface_roughness_mm", "line_angle_radius_mm",
        "box_clearance_mm", "finish_line_roughness_mm", "occlusoaxial_radius_mm",
        "occlusoaxial_radius_min_mm", "axiopulpal_radius_mm", "margin_gap_longest_mm"})
    if (q.key == free) return false;
  return true;
}

void widen_by_axis(Bench& bench) {
  const double axis = bench.frame().axis_uncertainty_deg;
  if (!(axis > 0)) return;
  const Quantity* height = find_quantity(bench.result.quantities, "wall_height_mm");
  const double lean = height ? height->value * std::sin(axis * kDegree) : 0;
  for (Quantity& q : bench.result.quantities) {
    if (!depends_on_axis(q)) continue;
    const double own = std::isfinite(q.uncertainty) ? q.uncertainty : 0;
    const double more = q.unit == "deg" ? axis
                        : q.key == "undercut_along_axis_mm"
                            ? lean
                            : q.value * (1 / std::cos(axis * kDegree) - 1);
    q.uncertainty = std::hypot(own, more);
  }
}

// ---- Drawings

// Marks of the walls that stand in a section's plane, and the dimension between them.
void mark_walls(const Bench& bench, Section& section, Side side,
                const std::vector<WallFacet>& walls) {
  const PreparationFrame& frame = bench.frame();
  const Vec3 normal = section.right.cross(section.up);
  std::vector<WallFacet> near;
  for (const WallFacet& w : walls)
    if (std::abs((bench.facets[w.facet].centroid - section.origin).dot(normal)) < 2 * bench.voxel())
      near.push_back(w);
  std::array<Wall, 2> pair = {wall_on(bench, side, near), wall_on(bench, opposite(side), near)};
  const double shift = (section.origin - frame.origin).dot(outward(side, frame));
  const double rise = frame.height(section.origin);
  for (int k = 0; k < 2; ++k) {
    const Wall& wall = pair[k];
    if (wall.middle.empty()) continue;
    const double low = wall.level - wall.height / 2, high = wall.level + wall.height / 2;
    const auto x = [&](double height) {
      return (k == 0 ? 1 : -1) * wall.distance_at(height) - shift;
    };
    section.marks.push_back({Vec2(x(low), low - rise), Vec2(x(high), high - rise),
                             text_of(wall.angle_deg, "{:.1f}\u00b0"), false});
  }
  if (pair[0].middle.empty() || pair[1].middle.empty()) return;
  const double level = (pair[0].level + pair[1].level) / 2;
  const double right = pair[0].distance_at(level), left = -pair[1].distance_at(level);
  section.marks.push_back({Vec2(left - shift, level - rise), Vec2(right - shift, level - rise),
                           text_of(right - left, "\u2194 {:.2f} mm"), true});
}

// The way along the axis from what the bur left at the section's middle to the original's surface.
void mark_depth(const Bench& bench, Section& section) {
  const PreparationFrame& frame = bench.frame();
  constexpr double kAbove = 50;  // mm, well out of the tooth
  const auto floor = bench.tree.first_hit(section.origin + kAbove * frame.d, -frame.d);
  if (!floor || bench.facets.facet_of(floor->triangle) < 0) return;
  const auto hit = bench.original_tree.first_hit(floor->point, frame.d);
  if (!hit) return;
  const double low = (floor->point - section.origin).dot(section.up);
  section.marks.push_back({Vec2(0, low), Vec2(0, low + hit->distance),
                           text_of(hit->distance, "\u2195 {:.2f} mm"), true});
}

void mark_margin(const Bench& bench, Section& section, Side side) {
  const PreparationFrame& frame = bench.frame();
  const Vec3 normal = section.right.cross(section.up);
  const double rise = frame.height(section.origin);
  std::vector<WallFacet> near;
  for (const WallFacet& w : bench.walls)
    if (std::abs((bench.facets[w.facet].centroid - section.origin).dot(normal)) < 2 * bench.voxel())
      near.push_back(w);
  for (const Side s : {side, opposite(side)}) {
    const Wall wall = wall_on(bench, s, near);
    if (wall.middle.empty()) continue;
    const Vec3 out = outward(s, frame);
    double best = 1e30;
    Vec3 finish = Vec3::Zero();
    for (const FinishSegment& f : bench.facets.finish_line()) {
      const Vec3 r = f.middle - section.origin;
      if (r.dot(out) <= 0 || frame.height(f.middle) > wall.level) continue;
      if (std::abs(r.dot(normal)) < best) {
        best = std::abs(r.dot(normal));
        finish = f.middle;
      }
    }
    if (best > 3 * bench.voxel()) continue;
    const double height = frame.height(finish);
    const double shift = (section.origin - frame.origin).dot(out);
    const double from = wall.distance_at(height) - shift;
    const double to = (finish - section.origin).dot(out) + bench.tolerance;
    const double sign = out.dot(section.right) > 0 ? 1 : -1;
    section.marks.push_back({Vec2(sign * from, height - rise), Vec2(sign * to, height - rise),
                             text_of(to - from, "\u2194 {:.2f} mm"), true});
  }
}

void draw_sections(Bench& bench, const TriangleMesh* target) {
  const PreparationFrame& frame = bench.frame();
  const bool crown = bench.options.type == PreparationType::kCrown;
  const TriangleMesh pulp = extract_surface(bench.original, SurfaceOf::kPulp);
  const TriangleMesh dentin = extract_surface(bench.original, SurfaceOf::kDentin);
  struct Plan {
    std::string name;
    Vec3 origin, right;
    Side side;
    const Floor* floor;
  };
  // A crown's sections go through the middle of the cut, a cavity's through that of its floor.
  const Floor* main = crown || bench.floors.empty() ? nullptr : &bench.floors[0];
  const auto centre_of = [&](const Floor* floor) -> Vec3 {
    if (!floor) return frame.origin;
    return frame.origin + floor->plane.centre.x() * frame.u + floor->plane.centre.y() * frame.v;
  };
  std::vector<Plan> plans = {
      {"buccolingual", centre_of(main), frame.v, Side::kBuccal, main},
      {"mesiodistal", centre_of(main), frame.u, Side::kMesial, main},
  };
  if (bench.options.type == PreparationType::kClass2) {
    const Floor* lowest = main;
    for (const Floor& f : bench.floors)
      if (f.area > 0.08 * main->area && f.plane.level < lowest->plane.level) lowest = &f;
    if (lowest != main)
      plans.push_back({"through the box", centre_of(lowest), frame.v, Side::kBuccal, lowest});
  }
  for (const Plan& plan : plans) {
    Section section;
    section.name = plan.name;
    section.origin = plan.origin;
    section.right = plan.right;
    section.up = frame.d;
    section.left_side = side_name(opposite(plan.side), frame);
    section.right_side = side_name(plan.side, frame);
    section.original = outlines_of(bench.original_surface, section);
    section.prepared = outlines_of(bench.surface, section);
    if (target) section.target = outlines_of(*target, section);
    section.pulp = outlines_of(pulp, section);
    section.dentin = outlines_of(dentin, section);
    std::vector<WallFacet> walls;
    for (const WallFacet& w : bench.walls)
      if (crown || plans.size() < 3 || w.floor < 0 || &bench.floors[w.floor] == plan.floor)
        walls.push_back(w);
    mark_walls(bench, section, plan.side, walls);
    mark_depth(bench, section);
    if (crown) mark_margin(bench, section, plan.side);
    bench.result.sections.push_back(std::move(section));
  }
}

// Depths of the prepared surface inside the original; 0 on a neighbouring tooth (what a layered
// tooth calls `other`). A groove in that is damage, given by its volume, and no wall or floor of the
// preparation.
std::vector<float> depth_of_cut(const TriangleMesh& surface, const LayeredTooth& original) {
  std::vector<float> depth = depth_inside(surface, original);
  if (has_tissues(surface))
    for (std::size_t v = 0; v < depth.size(); ++v)
      if (surface.tissue[v] == kOther) depth[v] = 0;
  return depth;
}

// What every measurement starts from.
struct Cut {
  TriangleMesh original_surface;
  double tolerance;  // mm
  CutFacets facets;
  PreparationFrame frame;
  std::vector<std::string> notes;

  Cut(const LayeredTooth& original, const LayeredTooth& prepared, const TriangleMesh& surface,
      const PreparationOptions& options)
      : original_surface(extract_surface(original, SurfaceOf::kAll)),
        tolerance(options.cut_tolerance > 0 ? options.cut_tolerance : original.lattice.voxel / 10),
        facets(surface, depth_of_cut(surface, original), tolerance) {
    if (facets.size() < kFewestFacets)
      throw Error("nothing was cut: no part of the prepared surface lies " +
                  fmt::format("{:.3g}", tolerance) + " mm or more inside the original");
    // The neighbour is outside what was prepared here, too.
    const bool layered = has_tissues(original_surface);
    std::vector<float> above = depth_inside(original_surface, prepared);
    for (std::size_t v = 0; v < above.size(); ++v)
      above[v] = layered && original_surface.tissue[v] == kOther ? 0 : -above[v];
    frame = find_frame(original, original_surface, above, facets, options, tolerance, notes);
  }
};

double smallest_floor(double voxel) { return std::max(0.1, 10 * voxel * voxel); }

}  // namespace

PreparationType guess_type(const LayeredTooth& original, const LayeredTooth& prepared,
                           const TriangleMesh& surface, const PreparationOptions& options) {
  const Cut cut(original, prepared, surface, options);
  const PreparationFrame& frame = cut.frame;
  const TriangleTree tree(has_tissues(surface) ? triangles_of(surface, false) : surface);
  double walls = 0, outside = 0;
  for (const Facet& f : cut.facets.all()) {
    if (std::abs(f.normal.dot(frame.d)) > std::sqrt(0.5)) continue;
    const Vec3 flat = (f.normal - f.normal.dot(frame.d) * frame.d).normalized();
    walls += f.area;
    if (!tree.hits(f.centroid + 0.01 * flat, flat)) outside += f.area;
  }
  if (outside > 0.6 * walls) return PreparationType::kCrown;
  const std::vector<Floor> floors =
      find_floors(cut.facets, frame, smallest_floor(original.lattice.voxel));
  return find_step(floors).pulpal >= 0 && outside > 0.02 * walls ? PreparationType::kClass2
                                                                 : PreparationType::kClass1;
}

Preparation measure_preparation(const LayeredTooth& original, const LayeredTooth& prepared,
                                const TriangleMesh& surface, const PreparationOptions& options,
                                const LayeredTooth* target) {
  if (!(options.undercut_threshold >= 0 && options.undercut_threshold <= 3))
    throw Error("the undercut threshold must lie between 0 and 3 mm");
  Cut cut(original, prepared, surface, options);
  const CutFacets& facets = cut.facets;
  const double voxel = original.lattice.voxel;
  Preparation result;
  result.frame = cut.frame;
  result.notes = std::move(cut.notes);
  const TriangleTree original_tree(cut.original_surface), tree(surface);
  Bench bench{original,      prepared, surface,       options, facets, cut.original_surface,
              original_tree, tree,     cut.tolerance, {},      {},     std::move(result)};
  bench.floors = find_floors(facets, bench.frame(), smallest_floor(voxel));
  if (bench.floors.empty() && options.type != PreparationType::kCrown)
    throw Error(
        "no floor was found: nothing of the cut faces the opening within 45 degrees; is "
        "the axis right, and the type?");
  bench.walls = find_walls(facets, bench.floors, bench.frame(), tree, options.type, voxel);

  switch (options.type) {
    case PreparationType::kCrown:
      measure_crown(bench);
      break;
    case PreparationType::kClass1:
      measure_cavity(bench, bench.floors[0], bench.walls);
      add_remaining_walls(bench, bench.walls);
      add_breakthrough(bench);
      break;
    case PreparationType::kClass2:
      measure_class2(bench);
      add_remaining_walls(bench, bench.walls);
      break;
  }
  measure_draw(bench);
  measure_pulp(bench);
  bench.add("surface_roughness_mm", surface_roughness(facets), NAN, "mm");
  if (options.type != PreparationType::kCrown) {
    const LineAngles line =
        line_angle_radius(facets, bench.walls, bench.floors, bench.frame(), tree);
    bench.add("line_angle_radius_mm", line.radius, radius_uncertainty(bench, line.angle_deg), "mm");
  }
  widen_by_axis(bench);
  TriangleMesh target_surface;
  if (target) target_surface = extract_surface(*target, SurfaceOf::kAll);
  draw_sections(bench, target ? &target_surface : nullptr);
  return std::move(bench.result);
}

}  // namespace toothprep
