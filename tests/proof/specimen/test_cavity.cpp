// Test preparations: their grids agree with their closed forms, and those with the definitions.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <limits>
#include <random>

#include "toothprep/proof/specimen/cavity.h"
#include "toothprep/proof/specimen/convex_polyhedron.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"

namespace toothprep {
namespace {

constexpr double kPi = units::kPi;
double tan_deg(double degrees) { return std::tan(units::from_degree(degrees)); }

Pose odd_pose() {
  Pose pose;
  pose.orientation = Quat(Eigen::AngleAxisd(0.83, Vec3(1, -2, 0.7).normalized()));
  pose.position = {3.217, -4.561, 7.893};
  return pose;
}

double figure(const CavityOptions& o, const std::string& key) {
  const auto value = truth_value(cavity_truth(o), key);
  EXPECT_TRUE(value.has_value()) << key;
  return value.value_or(std::numeric_limits<double>::quiet_NaN());
}

CavityOptions box() {
  CavityOptions o;
  o.size = {8, 6, 6};
  o.enamel = 1.2;
  return o;
}
CavityOptions tapered_box() {
  CavityOptions o = box();
  o.taper_u_plus = 12;
  o.taper_u_minus = 3;
  o.taper_v_plus = -6;
  o.taper_v_minus = 8;
  o.floor_tilt_u = 5;
  o.floor_tilt_v = -3;
  return o;
}
CavityOptions bowed_box() {
  CavityOptions o = box();
  o.bow = 0.3;
  o.taper_u_plus = 10;
  o.taper_u_minus = -4;
  o.taper_v_minus = 5;
  return o;
}
CavityOptions class2() {
  CavityOptions o = box();
  o.kind = CavityKind::kClass2;
  o.width = 1.6;
  o.length = 3;
  o.proximal_width = 3;
  o.axial_taper = 3;
  o.proximal_taper = -4;
  o.taper_u_minus = 4;
  o.pulp_depth = 2.6;
  o.pulp_size = {2, 1.5, 1.5};
  o.neighbour_gap = 0.3;
  o.neighbour_damage = 0.4;
  return o;
}
CavityOptions round_stump() {
  CavityOptions o;
  o.kind = CavityKind::kStump;
  o.size = {8, 7, 8};
  o.corner = 4;
  o.convergence_u = o.convergence_v = 12;
  o.pulp_depth = 3;
  return o;
}
CavityOptions rounded_stump() {
  CavityOptions o = round_stump();
  o.size = {9, 7, 8};
  o.corner = 2.5;
  return o;
}
CavityOptions sharp_stump() {
  CavityOptions o = round_stump();
  o.size = {9, 7, 8};
  o.corner = 0;
  o.convergence_u = 16;
  o.convergence_v = -6;
  o.pulp_depth = 1;  // exposed
  o.enamel = 0.8;
  return o;
}
CavityOptions grown(CavityOptions o, double offset) {
  o.offset = offset;
  o.neighbour_damage = 0;
  return o;
}

struct Named {
  const char* name;
  CavityOptions options;
};
std::vector<Named> all_kinds() {
  return {{"box", box()},
          {"tapered box", tapered_box()},
          {"bowed box", bowed_box()},
          {"class II", class2()},
          {"round stump", round_stump()},
          {"rounded stump", rounded_stump()},
          {"sharp stump", sharp_stump()},
          {"grown box", grown(box(), 0.25)},
          {"grown tapered box", grown(tapered_box(), 0.2)},
          {"grown stump", grown(rounded_stump(), 0.2)},
          {"grown sharp stump", grown(sharp_stump(), 0.15)}};
}

// ---- Polyhedra --------------------------------------

TEST(ConvexPolyhedron, HasTheVolumeAndTheDistancesOfACutBox) {
  const ConvexPolyhedron cube = box_polyhedron({0, 0, 0}, {1, 2, 3});
  EXPECT_NEAR(volume_mm3(cube), 6, 1e-12);
  EXPECT_NEAR(cube.distance({0.5, 1, 1.5}), -0.5, 1e-12);
  EXPECT_NEAR(cube.distance({2, 3, 4}), std::sqrt(3), 1e-12);  // corner
  EXPECT_NEAR(cube.distance({2, 1, 4}), std::sqrt(2), 1e-12);  // edge
  EXPECT_NEAR(cube.distance({0.5, 1, -2}), 2, 1e-12);          // face
  // The corner at the origin cut off: a tetrahedron of 1/6.
  const ConvexPolyhedron cut = clipped(cube, half_space({-1, -1, -1}, {1, 0, 0}));
  EXPECT_NEAR(volume_mm3(cut), 6 - 1.0 / 6, 1e-12);
  EXPECT_NEAR(cut.distance({0, 0, 0}), 1 / std::sqrt(3), 1e-12);
  EXPECT_TRUE(clipped(cube, {Vec3::UnitX(), -1}).empty());
  EXPECT_NEAR(distance_between(cube, box_polyhedron({2, 3, 4}, {5, 5, 5})), std::sqrt(3), 1e-12);
  EXPECT_EQ(distance_between(cube, cut), 0);
}

TEST(ConvexPolyhedron, GrowsBySteinersFormula) {
  // A box grown by r: V + A r + (pi/4) 4(a+b+c) r² + (4/3) pi r³; a plane through its middle halves
  // it.
  const ConvexPolyhedron body = box_polyhedron({-1, -2, -3}, {1, 2, 3});
  const double r = 0.3;
  const double shell =
      2 * (8 + 24 + 12) * r + kPi / 4 * 4 * (2 + 4 + 6) * r * r + 4 * kPi / 3 * r * r * r;
  bool exact = true;
  EXPECT_NEAR(shell_volume_mm3(body, r, Vec3::UnitZ(), -9, 9, exact), shell, 1e-12);
  EXPECT_NEAR(shell_volume_mm3(body, r, Vec3::UnitZ(), -9, 0, exact), shell / 2, 1e-12);
  EXPECT_TRUE(exact);
  shell_volume_mm3(body, r, Vec3::UnitZ(), -9, 2.9, exact);
  EXPECT_FALSE(exact);
}

// ---- Distances ---------------------------------------

TEST(Cavity, LiesBetweenThePlanesOfItsDefinition) {
  const CavityOptions o = tapered_box();
  const auto distance = cavity_distance(o);
  const auto at = [&](double u, double v, double w) { return distance({u, w, -v}); };
  for (const double w : {-1.7, -1.2, -0.4}) {
    EXPECT_NEAR(at(2 + (w + 2) * tan_deg(12), 0.1, w), 0, 1e-12);
    EXPECT_NEAR(at(-2 - (w + 2) * tan_deg(3), 0.1, w), 0, 1e-12);
    EXPECT_NEAR(at(0.3, 1.25 + (w + 2) * tan_deg(-6), w), 0, 1e-12);
    EXPECT_NEAR(at(0.3, -1.25 - (w + 2) * tan_deg(8), w), 0, 1e-12);
  }
  for (const double u : {-1.5, 0.0, 1.5})
    EXPECT_NEAR(at(u, 0.5, -2 + u * tan_deg(5) - 0.5 * tan_deg(3)), 0, 1e-12);
  EXPECT_LT(at(0, 0, -1), 0);
  EXPECT_GT(at(0, 0, -2.1), 0);
}

TEST(Cavity, IsRoundedWhereItsOffsetSurfaceIs) {
  const auto distance = cavity_distance(grown(box(), 0.25));
  // Outside the line angle of floor and end wall, and outside the corner of three planes.
  EXPECT_NEAR(distance(Vec3(2 + 0.3, -2 - 0.4, 0)), 0.5 - 0.25, 1e-12);
  EXPECT_NEAR(distance(Vec3(2 + 0.3, -2 - 0.4, -1.25 - 1.2)), 1.3 - 0.25, 1e-12);
  const auto stump = cavity_distance(grown(round_stump(), 0.2));
  // Inside the line angle of shoulder and wall: radius 3 at w = -5.5.
  EXPECT_NEAR(stump(Vec3(3 - 0.03, -5.5 - 0.04, 0)), 0.05 - 0.2, 1e-12);
  EXPECT_NEAR(stump(Vec3(0, -5.5 - 0.4, 3 + 0.3)), 0.4 - 0.2, 1e-12);
}

TEST(Cavity, HasABowedFloorAtItsTrueDistance) {
  CavityOptions o = box();
  for (const double bow : {0.4, -0.4, 1e-5}) {
    o.bow = bow;
    const auto distance = cavity_distance(o);
    const double k = bow / 4;  // sagitta over half of 4 mm
    for (const double u : {-1.5, -0.4, 0.0, 1.1})
      for (const double below : {-0.3, 0.0, 0.2, 0.5}) {
        // Along the parabola's normal at u.
        const Vec3 normal = Vec3(2 * k * u, -1, 0).normalized();
        const Vec3 x = Vec3(u, -2 + k * u * u, 0.2) + below * normal;
        ASSERT_LT(std::abs(x.x()), 1.9);  // away from the walls
        EXPECT_NEAR(distance(x), below, 1e-9) << bow << ' ' << u;
      }
  }
}

TEST(Cavity, HasTheSlopeOfADistance) {
  std::mt19937 random(7);
  for (const Named& kind : all_kinds()) {
    const auto distance = cavity_distance(kind.options);
    const auto place = [&](double a) { return a * (random() / 4294967296.0 - 0.5); };
    int near = 0, bad = 0;
    for (int n = 0; n < 40000; ++n) {
      const Vec3 x(place(9), place(6) - 3, place(9));
      const double d = distance(x);
      if (std::abs(d) > 0.3) continue;
      Vec3 gradient;
      constexpr double kStep = 1e-5;
      for (int a = 0; a < 3; ++a)
        gradient[a] = (distance(x + kStep * Vec3::Unit(a)) - distance(x - kStep * Vec3::Unit(a))) /
                      (2 * kStep);
      ++near;
      // Where two surfaces are equally near there is no slope: those points are few.
      bad += std::abs(gradient.norm() - 1) > 1e-4;
      ASSERT_LT(gradient.norm(), 1 + 1e-4) << kind.name << ' ' << x.transpose();
    }
    EXPECT_GT(near, 500) << kind.name;
    EXPECT_LT(bad, 0.002 * near) << kind.name;
  }
}

TEST(Cavity, TurnsWithItsPose) {
  for (Named kind : all_kinds()) {
    const auto straight = cavity_distance(kind.options);
    kind.options.pose = odd_pose();
    const auto turned = cavity_distance(kind.options);
    for (const Vec3& x : {Vec3(0.3, -1, 0.2), Vec3(2.1, -2.2, -1.4), Vec3(-3, -5.4, 1)})
      EXPECT_NEAR(turned(kind.options.pose.to_world(x)), straight(x), 1e-12) << kind.name;
  }
}

// ---- Grids against truths ----------------------------

TEST(Cavity, RemovesTheVolumesOfItsClosedForms) {
  for (Named kind : all_kinds())
    for (const bool turned : {false, true}) {
      CavityOptions& o = kind.options;
      if (turned) o.pose = odd_pose();
      const CavitySpecimen specimen = make_cavity(o);
      const auto before = remaining_volumes_mm3(specimen.original),
                 after = remaining_volumes_mm3(specimen.prepared);
      const CavityTruth truth = cavity_truth(o);
      double removed = 0;
      for (int k = 0; k < kTissueCount; ++k) removed += before[k] - after[k];
      const double total = *truth_value(truth, "removed_mm3.total");
      // 0.2 %: at edges a volume from a level set is of second order in the voxel.
      EXPECT_NEAR(removed, total, 2e-3 * total) << kind.name;
      for (int k = 0; k < kTissueCount; ++k) {
        const auto value = truth_value(truth, "removed_mm3." + std::string(kTissueNames[k]));
        if (!value) continue;
        // A tissue's part is also as good as half a percent of the whole.
        EXPECT_NEAR(before[k] - after[k], *value, 2e-3 * total + 1e-2 * *value)
            << kind.name << ' ' << kTissueNames[k] << (turned ? ", turned" : "");
      }
      std::printf("%-18s %-7s removed %9.4f, closed form %9.4f mm^3 (%+.3f %%)\n", kind.name,
                  turned ? "turned" : "", removed, total, 100 * (removed / total - 1));
    }
}

TEST(Cavity, HasClosedFormsThatAgreeWithAFineCount) {
  // Midpoint sums of what lies in the cavity and below the margin.
  for (const Named& kind : all_kinds()) {
    const CavityOptions& o = kind.options;
    if (o.neighbour_damage > 0) continue;
    const auto distance = cavity_distance(o);
    const bool stump = o.kind == CavityKind::kStump;
    constexpr double kStep = 0.08;
    double sum = 0;
    for (double x = -4.52; x < 4.52; x += kStep)
      for (double y = -6; y < 0; y += kStep)
        for (double z = -4.52; z < 4.52; z += kStep) {
          const Vec3 p(x + 0.001, y + kStep / 2, z + 0.002);
          double d = distance(p);
          if (stump) {
            const Vec3 q(std::abs(p.x()) - o.size.x() / 2 + o.corner, 0,
                         std::abs(p.z()) - o.size.z() / 2 + o.corner);
            d = std::max(d,
                         q.cwiseMax(0.0).norm() + std::min(std::max(q.x(), q.z()), 0.0) - o.corner);
          }
          sum += std::clamp(0.5 - d / kStep, 0.0, 1.0);
        }
    const double total = figure(o, "removed_mm3.total");
    EXPECT_NEAR(sum * kStep * kStep * kStep, total, 4e-3 * total) << kind.name;
  }
}

TEST(Cavity, LeavesEveryBitAsItWasWhereNothingWasCut) {
  for (Named kind : {Named{"box", tapered_box()}, Named{"class II", class2()},
                     Named{"stump", rounded_stump()}}) {
    kind.options.pose = odd_pose();
    const CavitySpecimen s = make_cavity(kind.options);
    const auto distance = cavity_distance(kind.options);
    ASSERT_EQ(s.original.lattice.origin, s.prepared.lattice.origin);
    int same = 0, cut = 0;
    for (std::size_t b = 0; b < s.original.solid.table_size(); ++b)
      for (int v = 0; v < kBrickVoxels; ++v) {
        ASSERT_EQ(s.original.tissue.brick(b)[v], s.prepared.tissue.brick(b)[v]);
        const float before = s.original.solid.brick(b)[v], after = s.prepared.solid.brick(b)[v];
        ASSERT_GE(after, before);
        const Index3 i = s.original.solid.brick_origin(b) + Index3(v >> 6, (v >> 3) & 7, v & 7);
        if (distance(s.original.lattice.to_world(i)) >= s.original.band()) {
          ASSERT_EQ(before, after);
          for (int k = 0; k < 3; ++k)
            ASSERT_EQ(s.original.remains[k].brick(b)[v], s.prepared.remains[k].brick(b)[v]);
          ++same;
        } else {
          cut += before != after;
        }
      }
    EXPECT_GT(same, 10000) << kind.name;
    EXPECT_GT(cut, 1000) << kind.name;
  }
}

TEST(Cavity, SparesTheNeighbourUnlessToldOtherwise) {
  CavityOptions o = class2();
  o.neighbour_damage = 0;
  o.neighbour_gap = 0.1;
  const CavitySpecimen s = make_cavity(o);
  constexpr int kOther = tissue_index(Tissue::kOther);
  EXPECT_EQ(remaining_volumes_mm3(s.original)[kOther], remaining_volumes_mm3(s.prepared)[kOther]);
  EXPECT_NEAR(remaining_volumes_mm3(s.original)[kOther], 8 * 6 * 6, 0.3);
  EXPECT_EQ(figure(o, "removed_mm3.other"), 0);
  o.neighbour_damage = 0.4;
  EXPECT_GT(figure(o, "removed_mm3.other"), 1);
}

TEST(Cavity, NamesItsAxesInTheWorld) {
  CavityOptions o = box();
  o.voxel = 0.2;
  const auto axis = [](const CavitySpecimen& s, const char* key) {
    Vec3 v;
    EXPECT_EQ(
        std::sscanf(s.prepared.provenance.at(key).c_str(), "%lf %lf %lf", &v.x(), &v.y(), &v.z()),
        3);
    return v;
  };
  const CavitySpecimen straight = make_cavity(o);
  EXPECT_EQ(straight.original.provenance.at("axis_occlusal"), "0 1 0");
  EXPECT_EQ(straight.original.provenance.at("axis_mesial"), "1 0 0");
  EXPECT_EQ(straight.original.provenance.at("axis_buccal"), "0 0 -1");
  EXPECT_EQ(straight.original.provenance.at("source"), "specimen cavity box");
  o.pose = odd_pose();
  const CavitySpecimen turned = make_cavity(o);
  const Vec3 u = axis(turned, "axis_mesial"), v = axis(turned, "axis_buccal"),
             w = axis(turned, "axis_occlusal");
  EXPECT_NEAR((u.cross(v) - w).norm(), 0, 1e-9);
  EXPECT_NEAR((o.pose.orientation * Vec3::UnitY() - w).norm(), 0, 1e-9);
}

TEST(Cavity, IsTheSameForAnyNumberOfThreads) {
  const auto built_with = [](int threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return tooth_sha256(make_cavity(tapered_box()).prepared);
  };
  EXPECT_EQ(built_with(1), built_with(2));
}

// ---- Truths -------------------------------------------

TEST(CavityTruth, OfAPlainBoxIsThatOfSchool) {
  const CavityOptions o = box();
  EXPECT_NEAR(figure(o, "removed_mm3.total"), 4 * 2.5 * 2, 1e-12);
  EXPECT_NEAR(figure(o, "removed_mm3.enamel"), 4 * 2.5 * 1.2, 1e-12);
  EXPECT_NEAR(figure(o, "depth_mm"), 2, 1e-12);
  EXPECT_EQ(figure(o, "undercut_max_mm"), 0);
  EXPECT_EQ(figure(o, "undercut_draws"), 1);
  EXPECT_NEAR(figure(o, "length_floor_mm"), 4, 1e-12);
  EXPECT_NEAR(figure(o, "width_margin_mm"), 2.5, 1e-12);
}

TEST(CavityTruth, GivesLengthsAtFloorMiddleAndMargin) {
  CavityOptions o = box();
  o.taper_u_plus = o.taper_u_minus = 10;
  EXPECT_NEAR(figure(o, "length_floor_mm"), 4, 1e-12);
  EXPECT_NEAR(figure(o, "length_mm"), 4 + 2 * tan_deg(10), 1e-12);
  EXPECT_NEAR(figure(o, "length_margin_mm"), 4 + 4 * tan_deg(10), 1e-12);
  // A frustum of constant width.
  EXPECT_NEAR(figure(o, "removed_mm3.total"), 2.5 * 2 * (4 + 2 * tan_deg(10)), 1e-12);
}

TEST(CavityTruth, KnowsTheUndercutOfADovetail) {
  CavityOptions o = box();
  o.taper_v_plus = o.taper_v_minus = -10;
  EXPECT_NEAR(figure(o, "undercut_max_mm"), 2 * tan_deg(10), 1e-12);
  EXPECT_NEAR(figure(o, "undercut_area_mm2"), 2 * 4 * 2 / std::cos(units::from_degree(10)), 1e-9);
  EXPECT_EQ(figure(o, "undercut_draws"), 0);
  o.taper_v_plus = 11;  // a tilted path frees the other wall
  EXPECT_EQ(figure(o, "undercut_draws"), 1);
  EXPECT_EQ(figure(o, "undercut_max_mm"), 0);
  EXPECT_NEAR(figure(o, "undercut_along_axis_mm"), 2 * tan_deg(10), 1e-12);
  o = class2();  // its box converges towards the occlusal by 4 degrees
  EXPECT_NEAR(figure(o, "undercut_max_mm"), 3.5 * tan_deg(4), 1e-12);
}

TEST(CavityTruth, KnowsATiltedAndABowedFloor) {
  CavityOptions o = box();
  o.floor_tilt_u = 6;
  EXPECT_NEAR(figure(o, "floor_tilt_deg"), 6, 1e-9);
  EXPECT_NEAR(figure(o, "depth_greatest_mm") - figure(o, "depth_least_mm"), 4 * tan_deg(6), 1e-9);
  // Evenly spread over the tilt: the 5 and 95 % values span 90 % of it.
  EXPECT_NEAR(figure(o, "depth_max_mm") - figure(o, "depth_min_mm"), 0.9 * 4 * tan_deg(6), 1e-9);
  EXPECT_NEAR(figure(o, "depth_mm"), 2, 1e-9);
  EXPECT_NEAR(figure(o, "removed_mm3.total"), 20, 1e-9);
  o = box();
  o.bow = 0.3;
  // RMS of a parabola of sagitta s about its mean, which is its best line: s 2/(3 sqrt 5).
  EXPECT_NEAR(figure(o, "floor_flatness_mm"), 0.3 * 2 / (3 * std::sqrt(5)), 1e-9);
  EXPECT_NEAR(figure(o, "floor_tilt_deg"), 0, 1e-6);
  EXPECT_NEAR(figure(o, "removed_mm3.total"), 2.5 * 4 * (2 - 0.1), 1e-9);
  EXPECT_NEAR(figure(o, "depth_mm"), 2 - 0.3 / 4, 1e-9);  // half the floor lies within |u| < 1
}

TEST(CavityTruth, KnowsWhatDentinRemains) {
  CavityOptions o = box();
  o.pulp_depth = 2.7;
  EXPECT_NEAR(figure(o, "remaining_dentin_min_mm"), 0.7, 1e-12);
  EXPECT_EQ(figure(o, "pulp_exposed"), 0);
  o.bow = -0.3;  // a hump: at the ends of the pulp's roof, u = 1.5, the floor is 0.3 (1.5/2)² lower
  const double at_edge = 0.7 - 0.3 * 0.5625;
  EXPECT_LT(figure(o, "remaining_dentin_min_mm"), at_edge);
  EXPECT_GT(figure(o, "remaining_dentin_min_mm"), at_edge - 0.1);
  o.bow = 0;
  o.floor_tilt_u = 10;  // the deepest edge of the floor, at u = -2, or the edge of the roof
  const double slope = tan_deg(10);
  EXPECT_NEAR(figure(o, "remaining_dentin_min_mm"),
              (0.7 - 1.5 * slope) * std::cos(units::from_degree(10)), 1e-9);
  o.depth = 2.6;
  EXPECT_EQ(figure(o, "pulp_exposed"), 1);
  EXPECT_EQ(figure(o, "remaining_dentin_min_mm"), 0);
  EXPECT_GT(figure(o, "removed_mm3.pulp"), 0);
}

TEST(CavityTruth, OfARoundStumpIsThatOfAFrustum) {
  const CavityOptions o = round_stump();
  const double t = tan_deg(6), r0 = 3, r1 = 3 - 4 * t;
  const double frustum = kPi * 4 / 3 * (r0 * r0 + r0 * r1 + r1 * r1);
  EXPECT_NEAR(figure(o, "removed_mm3.total"), kPi * 16 * 5.5 - frustum, 1e-9);
  EXPECT_NEAR(figure(o, "margin_width_mm"), 1, 1e-12);
  EXPECT_NEAR(figure(o, "axial_reduction_mm.buccal"), 1 + 2 * t, 1e-12);
  EXPECT_NEAR(figure(o, "wall_height_mm"), 4, 1e-12);
  EXPECT_NEAR(figure(o, "occlusal_reduction_mm"), 1.5, 1e-12);
  // From the pulp's corner at (1.5, 1), 3 mm below the top, to the wall.
  EXPECT_NEAR(figure(o, "remaining_dentin_min_mm"),
              (3 - 2.5 * t - std::hypot(1.5, 1)) * std::cos(units::from_degree(6)), 1e-9);
  EXPECT_EQ(figure(o, "undercut_max_mm"), 0);
}

TEST(CavityTruth, OfAGrownBoxFollowsSteiner) {
  const double r = 0.25;
  // Below the margin: floor and four walls, four horizontal and four vertical quarter cylinders,
  // four eighths of a ball.
  const double shell = 4 * 2.5 * r + 2 * (4 + 2.5) * 2 * r +
                       kPi / 4 * r * r * (2 * (4 + 2.5) + 4 * 2) + 4 * kPi / 6 * r * r * r;
  const CavityOptions o = grown(box(), r);
  EXPECT_NEAR(figure(o, "over_prepared_mm3"), shell, 1e-9);
  EXPECT_NEAR(figure(o, "removed_mm3.total"), 20 + shell, 1e-9);
  EXPECT_NEAR(figure(o, "dice"), 40 / (40 + shell), 1e-9);
  EXPECT_NEAR(figure(o, "depth_mm"), 2.25, 1e-12);
  EXPECT_NEAR(figure(o, "length_floor_mm"), 4.5, 1e-12);
}

TEST(CavityTruth, HasEachKeyOnceAndOnlyNumbers) {
  for (const Named& kind : all_kinds()) {
    std::vector<std::string> keys;
    for (const TruthFigure& f : cavity_truth(kind.options)) {
      EXPECT_TRUE(std::isfinite(f.value)) << kind.name << ' ' << f.key;
      EXPECT_EQ(std::count(keys.begin(), keys.end(), f.key), 0) << f.key;
      keys.push_back(f.key);
    }
  }
}

// ---- Refusals -----------------------------------------

TEST(Cavity, RefusesWhatCannotBeOne) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  const auto refused = [](CavityOptions o, auto change) {
    change(o);
    EXPECT_THROW(check_cavity(o), Error);
    EXPECT_THROW(cavity_truth(o), Error);
  };
  for (const double bad : {nan, infinity, -1.0, 0.0, 99.0}) {
    refused(box(), [&](CavityOptions& o) { o.length = bad; });
    refused(box(), [&](CavityOptions& o) { o.width = bad; });
    refused(box(), [&](CavityOptions& o) { o.depth = bad; });
    refused(box(), [&](CavityOptions& o) { o.voxel = bad; });
    refused(box(), [&](CavityOptions& o) { o.size.z() = bad; });
    refused(class2(), [&](CavityOptions& o) { o.proximal_width = bad; });
    refused(class2(), [&](CavityOptions& o) { o.gingival_depth = bad; });
    refused(class2(), [&](CavityOptions& o) { o.axial_depth = bad; });
    refused(round_stump(), [&](CavityOptions& o) { o.shoulder_level = bad; });
    refused(round_stump(), [&](CavityOptions& o) { o.shoulder_width = bad; });
  }
  for (const double bad : {nan, infinity, -30.0, 45.0, 90.0}) {
    refused(box(), [&](CavityOptions& o) { o.taper_u_plus = bad; });
    refused(box(), [&](CavityOptions& o) { o.taper_v_minus = bad; });
    refused(class2(), [&](CavityOptions& o) { o.axial_taper = bad; });
  }
  for (const double bad : {nan, infinity, -0.1, 2.0})
    refused(box(), [&](CavityOptions& o) { o.offset = bad; });
  refused(box(), [](CavityOptions& o) { o.length = 8; });  // leaves the tooth
  refused(box(), [](CavityOptions& o) { o.depth = 6; });
  refused(box(), [](CavityOptions& o) {  // walls meet above the floor
    o.taper_v_plus = o.taper_v_minus = 40;
    o.floor_tilt_v = 0;
    o.width = 0.1;
    o.floor_tilt_u = 10;
  });
  refused(box(), [](CavityOptions& o) { o.taper_v_plus = o.taper_v_minus = -29.9, o.width = 2; });
  refused(box(), [](CavityOptions& o) { o.floor_tilt_u = 29, o.depth = 1; });  // floor above margin
  refused(bowed_box(), [](CavityOptions& o) { o.offset = 0.1; });
  refused(bowed_box(), [](CavityOptions& o) { o.pulp_depth = 2; });
  refused(box(), [](CavityOptions& o) { o.pulp_depth = 1; });  // in the enamel
  refused(box(), [](CavityOptions& o) { o.pulp_depth = 5; });
  refused(class2(), [](CavityOptions& o) { o.width = 3.2; });  // wider than the box
  refused(class2(), [](CavityOptions& o) { o.gingival_depth = 1.9; });
  refused(class2(), [](CavityOptions& o) { o.neighbour_gap.reset(); });
  refused(round_stump(), [](CavityOptions& o) { o.convergence_v = 10; });
  refused(round_stump(), [](CavityOptions& o) { o.stump_corner = 3.5; });
  refused(round_stump(), [](CavityOptions& o) { o.stump_corner = 0; });  // edges leave the cylinder
  refused(round_stump(), [](CavityOptions& o) { o.pulp_size.x() = 6; });
  refused(sharp_stump(), [](CavityOptions& o) { o.convergence_u = 59, o.occlusal_reduction = 0; });
}

}  // namespace
}  // namespace toothprep
