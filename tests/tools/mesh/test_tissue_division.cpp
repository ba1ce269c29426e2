// Where one tissue ends and the next begins on a surface is a line of its edges. Here the tissues
// are fields, so the line is known; CGAL judges the surface.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <random>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "surfaces.h"
#include "toothprep/proof/specimen/molar.h"
#include "toothprep/tools/mesh/line_file.h"
#include "toothprep/tools/mesh/tissue_division.h"

namespace toothprep {
namespace {

using surfaces::box_distance;
using surfaces::expect_valid;
using Field = std::function<double(const Vec3&)>;

struct Tooth {
  std::string name;
  Field outside, dentin;  // enamel is what of the tooth is not dentin
  Field cut;              // or none
};

LayeredTooth layered(const Tooth& t, double half_size, double voxel) {
  Lattice lattice;
  lattice.voxel = voxel;
  lattice.origin = Vec3(0.0131, 0.0272, -0.0393);
  const int n = static_cast<int>(std::ceil(half_size / voxel)) + 4;
  LayeredTooth tooth = build_tooth(
      lattice, Index3::Constant(-n), Index3::Constant(n),
      [&](const Vec3& x) {
        ToothSample s;
        s.solid = static_cast<float>(t.outside(x));
        const auto dentin = static_cast<float>(t.dentin(x));
        s.tissue = {std::max(s.solid, -dentin), std::max(s.solid, dentin), 1e3F};
        if (s.solid < 0) s.label = dentin < 0 ? Tissue::kDentin : Tissue::kEnamel;
        return s;
      },
      false);
  if (t.cut) surfaces::cut_by(tooth, t.cut);
  return tooth;
}

Vec3 gradient(const Field& f, const Vec3& x) {
  constexpr double kStep = 1e-6;
  Vec3 g;
  for (int k = 0; k < 3; ++k)
    g[k] = (f(x + kStep * Vec3::Unit(k)) - f(x - kStep * Vec3::Unit(k))) / (2 * kStep);
  return g;
}

// From a place near it to the curve in which two surfaces meet, to first order.
double from_curve(const Field& f, const Field& g, const Vec3& x) {
  Eigen::Matrix<double, 2, 3> slopes;
  slopes.row(0) = gradient(f, x).transpose();
  slopes.row(1) = gradient(g, x).transpose();
  const Eigen::Matrix2d normal = slopes * slopes.transpose();
  return (slopes.transpose() * normal.inverse() * Eigen::Vector2d(f(x), g(x))).norm();
}

struct Errors {
  double most = 0, rms = 0;
  std::size_t count = 0;
};

// Of the vertices of the border of enamel and dentin, in voxels.
Errors border_errors(const Tooth& t, const SharpSurface& surface, double voxel) {
  const Field remains = [&](const Vec3& x) {
    return t.cut ? std::max(t.outside(x), -t.cut(x)) : t.outside(x);
  };
  Errors errors;
  for (const TissueBorder& border : tissue_borders(surface.mesh))
    for (const auto& edge : border.edges)
      for (const std::uint32_t v : edge) {
        const double e =
            from_curve(remains, t.dentin, surface.mesh.vertices[v].cast<double>()) / voxel;
        errors.most = std::max(errors.most, e);
        errors.rms += e * e;
        ++errors.count;
      }
  errors.rms = std::sqrt(errors.rms / static_cast<double>(std::max<std::size_t>(errors.count, 1)));
  return errors;
}

Field ball(const Vec3& middle, double radius) {
  return [=](const Vec3& x) { return (x - middle).norm() - radius; };
}
Field below(const Vec3& normal, double height) {
  return [n = normal.normalized(), height](const Vec3& x) { return n.dot(x) - height; };
}

std::vector<Tooth> teeth() {
  const Quat q(Eigen::AngleAxisd(0.6, Vec3(1, 2, 3).normalized()));
  const Field slot = [q](const Vec3& x) {
    return box_distance(q.conjugate() * (x - q * Vec3(0, 2.6, 0)), Vec3(0.62, 1.05, 4));
  };
  const Field dish = ball(q * Vec3(0, 3.4, 0), 1.5);
  return {{"ball of dentin, slot", ball(Vec3::Zero(), 3), ball(Vec3(0.1, 0, 0.2), 2.2), slot},
          {"ball of dentin, dish", ball(Vec3::Zero(), 3), ball(Vec3(0.1, 0, 0.2), 2.2), dish},
          {"plane, slot", ball(Vec3::Zero(), 3), below(Vec3(1, 5, 2), 2.0), slot},
          {"plane at 40 degrees, uncut", ball(Vec3::Zero(), 3), below(Vec3(1, 5, 2), 2.3), {}}};
}

using Edge = std::array<std::uint32_t, 2>;

Edge ascending(std::uint32_t a, std::uint32_t b) { return {std::min(a, b), std::max(a, b)}; }

std::map<std::uint32_t, int> ends_of(const std::vector<Edge>& edges) {
  std::map<std::uint32_t, int> ends;
  for (const Edge& edge : edges)
    for (const std::uint32_t v : edge) ++ends[v];
  return ends;
}

std::set<Edge> edges_of(const TriangleMesh& mesh) {
  std::set<Edge> edges;
  for (const auto& t : mesh.triangles)
    for (std::size_t k = 0; k < 3; ++k) edges.insert(ascending(t[k], t[(k + 1) % 3]));
  return edges;
}

// Measured: 0.026 to 0.053 voxels at most, 0.006 to 0.031 rms. The linear fit's error is half the
// border's curvature (1/22 voxels for the ball) times some square voxels.
TEST(TissueDivision, BordersAreWithinATenthOfAVoxelOfTheCurveInWhichTissuesMeetOnTheSurface) {
  for (const Tooth& t : teeth())
    for (const double voxel : {0.1, 0.05}) {
      if (voxel < 0.1 && t.name != "plane, slot") continue;  // which has the sharpest wedges
      SCOPED_TRACE(t.name + ", " + std::to_string(voxel));
      const SharpSurface surface = surface_by_tissue(layered(t, 3.1, voxel));
      const Errors e = border_errors(t, surface, voxel);
      EXPECT_GT(e.count, 200u);
      EXPECT_LT(e.most, 0.1);
      EXPECT_LT(e.rms, 0.04);
      if (voxel == 0.1) expect_valid(surface.mesh);
    }
}

// To where three surfaces meet, to first order.
double from_point(const Field& f, const Field& g, const Field& h, const Vec3& x) {
  Eigen::Matrix3d slopes;
  slopes << gradient(f, x).transpose(), gradient(g, x).transpose(), gradient(h, x).transpose();
  return (slopes.inverse() * Vec3(f(x), g(x), h(x))).norm();
}

// Whether a field has no crease within a voxel or so.
bool even_about(const Field& f, const Vec3& x, double voxel) {
  for (int k = 0; k < 3; ++k) {
    const Vec3 way = 1.5 * voxel * Vec3::Unit(k);
    if ((gradient(f, x + way) - gradient(f, x - way)).norm() > 0.5) return false;
  }
  return true;
}

// A cavity whose margin runs from enamel into dentin and back. A slot through a ball crosses the
// plane on both walls and both sides, a cavity within a block's face at two places. Where a line angle of
// the cut comes out the margin has a corner, which is bevelled within a voxel, as the block's edges are.
TEST(TissueDivision, MarginAndBorderMeetInAVertexWhereTheMarginCrossesTissues) {
  const Quat q(Eigen::AngleAxisd(0.6, Vec3(1, 2, 3).normalized()));
  const auto box = [q](const Vec3& middle, const Vec3& half) -> Field {
    return [=](const Vec3& x) { return box_distance(q.conjugate() * x - middle, half); };
  };
  const Tooth block{"block", box(Vec3::Zero(), Vec3(1.8, 1.5, 1.6)), below(q * Vec3(5, 2, 1), 0.3),
                    box(Vec3(0.1, 1.5, -0.1), Vec3(0.9, 0.8, 0.7))};
  for (const auto& [t, size, crossings] :
       {std::tuple{teeth()[2], 3.1, 4u}, std::tuple{block, 2.8, 2u}})
    for (const double voxel : {0.1, 0.05}) {
      if (voxel < 0.1 && t.name != "block") continue;  // time
      SCOPED_TRACE(t.name + ", " + std::to_string(voxel));
      const SharpSurface surface = surface_by_tissue(layered(t, size, voxel));
      const auto at = [&](std::uint32_t v) -> Vec3 {
        return surface.mesh.vertices[v].cast<double>();
      };
      const std::map<std::uint32_t, int> margin = ends_of(surface.margin);
      const auto even = [&](const Vec3& x) {
        return even_about(t.outside, x, voxel) && even_about(t.cut, x, voxel);
      };
      Errors off_margin, off_border, off_point;
      const auto note = [voxel](Errors& errors, double away) {
        errors.most = std::max(errors.most, away / voxel);
        ++errors.count;
      };
      for (const auto& [v, count] : margin) {
        ASSERT_EQ(count, 2);
        if (even(at(v))) note(off_margin, from_curve(t.outside, t.cut, at(v)));
      }
      const std::vector<TissueBorder> borders = tissue_borders(surface.mesh);
      ASSERT_EQ(borders.size(), 1u);
      const Field remains = [&t](const Vec3& x) { return std::max(t.outside(x), -t.cut(x)); };
      for (const auto& [v, count] : ends_of(borders[0].edges)) {
        ASSERT_EQ(count, 2);
        if (margin.count(v))
          note(off_point, from_point(t.outside, t.cut, t.dentin, at(v)));
        else if (even(at(v)))
          note(off_border, from_curve(remains, t.dentin, at(v)));
      }
      EXPECT_EQ(off_point.count, crossings);
      EXPECT_GT(std::min(off_margin.count, off_border.count), 100u);
      EXPECT_LT(std::max({off_margin.most, off_border.most, off_point.most}), 0.1);
      std::printf("%s, %.2f mm: margin %.3f, border %.3f, crossings %.3f voxels\n", t.name.c_str(),
                  voxel, off_margin.most, off_border.most, off_point.most);
    }
}

// Signed distances from a curve, voxels.
struct Spread {
  double mean = 0, deviation = 0;
};
Spread spread_of(const std::vector<double>& errors) {
  Spread s;
  for (const double e : errors) s.mean += e / static_cast<double>(errors.size());
  for (const double e : errors)
    s.deviation += (e - s.mean) * (e - s.mean) / static_cast<double>(errors.size());
  s.deviation = std::sqrt(s.deviation);
  return s;
}

// On the synthetic molar's own surface enamel ends in a feather edge of 31 degrees. The border
// runs through edges between the vertices' labels (in their middles, on average), and the divided one
// along its vertices; the second one shall not wave.
TEST(TissueDivision, TheBorderAtTheCervixOfAMolarIsSmooth) {
  const Field junction = [](const Vec3& x) {  // on the surface: negative in dentin
    const ToothSample s = sample_molar(x);
    return static_cast<double>(s.tissue[1] > s.solid ? s.tissue[1] : -s.tissue[0]);
  };
  MolarOptions options;
  options.voxel = 0.2;
  const LayeredTooth tooth = make_molar(options);
  const auto error = [&](const Vec3& x) {
    return junction(x) / gradient(junction, x).norm() / options.voxel;
  };
  std::vector<double> by_labels, divided;
  const TriangleMesh whole = extract_surface(tooth, SurfaceOf::kAll);
  for (const auto& t : whole.triangles)
    for (std::size_t k = 0; k < 3; ++k)
      if (const auto a = t[k], b = t[(k + 1) % 3]; whole.tissue[a] < whole.tissue[b])
        by_labels.push_back(error(0.5 * (whole.vertices[a] + whole.vertices[b]).cast<double>()));
  const TriangleMesh mesh = surface_by_tissue(tooth).mesh;
  for (const TissueBorder& border : tissue_borders(mesh))
    for (const auto& edge : border.edges)
      divided.push_back(error(mesh.vertices[edge[0]].cast<double>()));
  const Spread before = spread_of(by_labels), after = spread_of(divided);
  std::printf("cervix, voxels: %.3f +- %.3f by labels, %.3f +- %.3f divided\n", before.mean,
              before.deviation, after.mean, after.deviation);
  EXPECT_LT(after.deviation, 0.5 * before.deviation);
  EXPECT_LT(std::abs(after.mean) + 2 * after.deviation, 0.4);
}

TEST(TissueDivision, LeavesTheSurfaceWhereItWasWithClosedBordersAndMargins) {
  const Tooth t = teeth()[0];
  const LayeredTooth tooth = layered(t, 3.1, 0.1);
  const SharpSurface whole = extract_sharp_surface(tooth), divided = surface_by_tissue(tooth);
  ASSERT_EQ(divided.mesh.triangle_tissue.size(), divided.mesh.triangles.size());
  EXPECT_GT(divided.mesh.triangles.size(), whole.mesh.triangles.size());
  EXPECT_NEAR(mesh_volume_mm3(divided.mesh), mesh_volume_mm3(whole.mesh), 1e-4);
  const std::set<Edge> edges = edges_of(divided.mesh);
  const std::vector<TissueBorder> borders = tissue_borders(divided.mesh);
  ASSERT_EQ(borders.size(), 1u);
  EXPECT_EQ(borders[0].between, (std::array{Tissue::kEnamel, Tissue::kDentin}));
  for (const auto* lines : {&borders[0].edges, &divided.margin}) {
    ASSERT_FALSE(lines->empty());
    for (const auto& [v, count] : ends_of(*lines)) ASSERT_EQ(count, 2) << v;
    for (const auto& [a, b] : *lines) ASSERT_EQ(edges.count(ascending(a, b)), 1u);
  }
  for (const auto& [a, b] : divided.creases) ASSERT_EQ(edges.count(ascending(a, b)), 1u);
}

// Enamel, dentin and pulp all meet on the cut; random fields, so that borders run everywhere.
TEST(TissueDivision, IsValidWhereThreeTissuesMeetAndWhereBordersAreNoise) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> noise(-0.15F, 0.045F);
  LayeredTooth tooth = layered(teeth()[0], 3.1, 0.1);
  for (PackedLevelSet& level : tooth.remains)
    for (std::size_t b = 0; b < level.table_size(); ++b) {
      const Index3 first = level.brick_origin(b);
      std::array<float, kBrickVoxels> values;
      for (int v = 0; v < kBrickVoxels; ++v) {
        const Index3 i = first + Index3(v >> 6, v >> 3 & 7, v & 7);
        values[v] = std::max(noise(random), tooth.solid.value(i.x(), i.y(), i.z()));
      }
      level.set_brick(b, values.data());
    }
  const SharpSurface surface = surface_by_tissue(tooth);
  const surfaces::Mesh mesh = surfaces::judged(surface.mesh);
  EXPECT_TRUE(CGAL::is_closed(mesh));
  EXPECT_EQ(tissue_borders(surface.mesh).size(), 3u);
  std::map<std::uint32_t, int> ends;
  for (const TissueBorder& border : tissue_borders(surface.mesh))
    for (const auto& [v, count] : ends_of(border.edges)) ends[v] += count;
  int threes = 0;
  for (const auto& [v, count] : ends) {
    ASSERT_NE(count, 1) << "a border that ends";
    threes += count == 3;
  }
  EXPECT_GT(threes, 50);
  EXPECT_NEAR(mesh_volume_mm3(surface.mesh), mesh_volume_mm3(extract_sharp_surface(tooth).mesh),
              1e-4);
}

TEST(TissueDivision, IsTheSameBitsForAnyNumberOfThreads) {
  const LayeredTooth tooth = layered(teeth()[1], 3.1, 0.1);
  const SharpSurface many = surface_by_tissue(tooth);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const SharpSurface alone = surface_by_tissue(tooth);
  EXPECT_EQ(many.mesh.vertices, alone.mesh.vertices);
  EXPECT_EQ(many.mesh.triangles, alone.mesh.triangles);
  EXPECT_EQ(many.mesh.triangle_tissue, alone.mesh.triangle_tissue);
  EXPECT_EQ(many.margin, alone.margin);
}

TEST(Polylines, PassEachEdgeOnceFromBranchToBranchAndRoundClosedOnes) {
  // A path 1-2-3-4, a branch 3-5, and a triangle 7-8-9.
  const auto lines = polylines_of({{2, 1}, {3, 2}, {3, 4}, {5, 3}, {8, 7}, {9, 8}, {7, 9}});
  EXPECT_THAT(lines, testing::UnorderedElementsAre(
                         testing::ElementsAre(1, 2, 3), testing::ElementsAre(3, 4),
                         testing::ElementsAre(3, 5), testing::ElementsAre(7, 8, 9, 7)));
}

}  // namespace
}  // namespace toothprep
