// A decimated mesh stays within the bound of the given one. CGAL's sampled distances, and its exact
// predicates, are the judge.
#include <CGAL/Polygon_mesh_processing/connected_components.h>
#include <CGAL/Polygon_mesh_processing/distance.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <set>
#include <vector>

#include "../mesh/surfaces.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/decimation/decimation.h"
#include "toothprep/tools/decimation/surface_distance.h"
#include "toothprep/tools/mesh/sharp_surface.h"
#include "toothprep/tools/mesh/tissue_division.h"

namespace toothprep {
namespace {

namespace pmp = CGAL::Polygon_mesh_processing;
using surfaces::box_distance;
using surfaces::cut_tooth;
using surfaces::expect_valid;
using surfaces::judged;
using surfaces::tooth_of;
using Edges = std::vector<std::array<std::uint32_t, 2>>;

double from_segment(const Vec3& x, const Vec3& a, const Vec3& b) {
  const double t = std::clamp((x - a).dot(b - a) / (b - a).squaredNorm(), 0.0, 1.0);
  return (x - a - t * (b - a)).norm();
}

// The farthest of points on the one lines from the other lines, mm.
double line_distance(const TriangleMesh& from, const Edges& edges, const TriangleMesh& to,
                     const Edges& others) {
  const auto at = [](const TriangleMesh& m, std::uint32_t v) -> Vec3 {
    return m.vertices[v].cast<double>();
  };
  double most = 0;
  for (const auto& [a, b] : edges)
    for (const double w : {0.0, 0.25, 0.5, 0.75, 1.0}) {
      const Vec3 x = (1 - w) * at(from, a) + w * at(from, b);
      double nearest = std::numeric_limits<double>::infinity();
      for (const auto& [c, d] : others)
        nearest = std::min(nearest, from_segment(x, at(to, c), at(to, d)));
      most = std::max(most, nearest);
    }
  return most;
}

// Corners and labels of the triangles over which a border of tissues runs.
std::set<std::array<float, 12>> border_triangles(const TriangleMesh& mesh) {
  std::set<std::array<float, 12>> found;
  for (auto t : mesh.triangles) {
    if (mesh.tissue[t[0]] == mesh.tissue[t[1]] && mesh.tissue[t[1]] == mesh.tissue[t[2]]) continue;
    const auto less = [&](std::uint32_t a, std::uint32_t b) {
      const auto &x = mesh.vertices[a], &y = mesh.vertices[b];
      return std::lexicographical_compare(x.data(), x.data() + 3, y.data(), y.data() + 3);
    };
    std::rotate(t.begin(), std::min_element(t.begin(), t.end(), less), t.end());
    std::array<float, 12> entry{};
    for (std::size_t k = 0; k < 3; ++k) {
      std::copy_n(mesh.vertices[t[k]].data(), 3, entry.begin() + static_cast<long>(4 * k));
      entry[4 * k + 3] = mesh.tissue[t[k]];
    }
    found.insert(entry);
  }
  return found;
}

std::size_t parts(const surfaces::Mesh& mesh) {
  std::vector<std::size_t> part(mesh.num_faces());
  return pmp::connected_components(
      mesh, boost::make_iterator_property_map(part.begin(), get(boost::face_index, mesh)));
}

// Everything that decimate() promises, and its result.
Decimation expect_decimated(const TriangleMesh& mesh, const Edges& lines, double bound) {
  Decimation d = decimate(mesh, lines, bound);
  EXPECT_TRUE(d.decimated);
  EXPECT_LT(d.mesh.triangles.size(), mesh.triangles.size());
  expect_valid(d.mesh);
  const surfaces::Mesh before = judged(mesh), after = judged(d.mesh);
  EXPECT_EQ(parts(after), parts(before));
  const auto dense = CGAL::parameters::number_of_points_per_area_unit(2000).random_seed(1);
  const double sampled =
      std::max(pmp::approximate_Hausdorff_distance<CGAL::Sequential_tag>(before, after, dense),
               pmp::approximate_Hausdorff_distance<CGAL::Sequential_tag>(after, before, dense));
  EXPECT_LE(sampled, bound);
  EXPECT_LE(d.greatest_mm, bound);
  EXPECT_LE(std::abs(mesh_volume_mm3(d.mesh) - mesh_volume_mm3(mesh)), bound * pmp::area(before));
  EXPECT_EQ(border_triangles(d.mesh), border_triangles(mesh)) << "borders stay in their place";
  EXPECT_EQ(lines.empty(), d.lines.empty());
  if (!lines.empty()) {
    constexpr double kRounding = 1e-9;
    EXPECT_LE(line_distance(mesh, lines, d.mesh, d.lines), bound + kRounding);
    EXPECT_LE(line_distance(d.mesh, d.lines, mesh, lines), bound + kRounding);
    EXPECT_NEAR(d.greatest_of_lines_mm, line_distance(mesh, lines, d.mesh, d.lines), 1e-9);
  }
  return d;
}

TriangleMesh surface_of(const std::function<double(const Vec3&)>& field, double half_size,
                        double voxel) {
  return extract_surface(tooth_of(field, half_size, voxel), SurfaceOf::kAll);
}

// Six flat walls need 12 triangles, and its edges, bevelled by marching cubes, one row each: four
// triangles for each of 12 edges and a few at the 8 corners. Within 1/50 of the voxel some more.
TEST(Decimation, OfABlockLeavesAFiftiethOfItsTriangles) {
  const TriangleMesh block =
      surface_of([](const Vec3& x) { return box_distance(x, Vec3(1.52, 1.52, 1.52)); }, 1.6, 0.1);
  const Decimation d = expect_decimated(block, {}, 0.002);
  EXPECT_LT(d.mesh.triangles.size(), block.triangles.size() / 50);
}

// A chord of the length s is s²/8R from the sphere, so triangles of a side s are within E for
// s² = 8 E R or so, and the number of triangles falls as 1/E.
TEST(Decimation, OfASphereLeavesTrianglesInInverseProportionToTheBound) {
  const TriangleMesh sphere = surface_of([](const Vec3& x) { return x.norm() - 2; }, 2.1, 0.1);
  const auto coarse = static_cast<double>(expect_decimated(sphere, {}, 0.04).mesh.triangles.size());
  const auto fine = static_cast<double>(expect_decimated(sphere, {}, 0.01).mesh.triangles.size());
  EXPECT_GT(fine / coarse, 2.5);
  EXPECT_LT(fine / coarse, 6);
}

TEST(Decimation, KeepsBothSidesOfAPlateApartThatIsThinnerThanTwiceTheBound) {
  const TriangleMesh plate =
      surface_of([](const Vec3& x) { return box_distance(x, Vec3(1.5, 0.04, 1.5)); }, 1.6, 0.05);
  expect_decimated(plate, {}, 0.05);
}

TEST(Decimation, KeepsAPartThatIsSmallerThanTheBound) {
  const TriangleMesh two = surface_of(
      [](const Vec3& x) {
        return std::min(box_distance(x, Vec3(0.6, 0.6, 0.6)), (x - Vec3(1.3, 0, 0)).norm() - 0.15);
      },
      1.6, 0.1);
  for (const double bound : {0.02, 0.4}) expect_decimated(two, {}, bound);
}

// A slot with a deeper box at its open end, in enamel over dentin, turned so that nothing follows
// the lattice.
LayeredTooth class2(double voxel) {
  const Quat turn(Eigen::AngleAxisd(0.3, Vec3(1, 2, 3).normalized()));
  const auto local = [turn](const Vec3& x) -> Vec3 { return turn.conjugate() * x; };
  const auto intact = [local](const Vec3& x) {
    return box_distance(local(x), Vec3(1.8, 1.4, 1.4));
  };
  const auto cut = [local](const Vec3& x) {
    const Vec3 l = local(x);
    return std::min(box_distance(l - Vec3(0.9, 1.4, 0), Vec3(1.6, 0.5, 0.35)),
                    box_distance(l - Vec3(1.9, 1.0, 0), Vec3(0.6, 1.1, 0.7)));
  };
  return cut_tooth(intact, cut, 2.6, voxel);
}

TEST(Decimation, KeepsTheMarginAndTheBordersOfTissuesOfAClass2Cavity) {
  SharpSurface surface = extract_sharp_surface(class2(0.1));
  for (std::size_t v = 0; v < surface.mesh.vertices.size(); ++v)  // a border that is no crease
    surface.mesh.tissue[v] = surface.mesh.vertices[v].y() > 0.43F ? 1 : 2;
  ASSERT_FALSE(surface.margin.empty());
  const std::size_t before = surface.mesh.triangles.size();
  for (const double bound : {0.005, 0.05}) {
    SCOPED_TRACE(bound);
    const Decimation d = expect_decimated(surface.mesh, surface.margin, bound);
    EXPECT_LT(d.mesh.triangles.size(), before / (bound < 0.01 ? 2 : 4));
    EXPECT_LT(d.lines.size(), surface.margin.size() / 2) << "the margin is straightened, too";
  }
}

// A border of tissues that runs over walls, floor and margin, as lines of edges.
TEST(Decimation, StraightensTheBordersOfTissuesWithinTheBound) {
  LayeredTooth tooth = class2(0.15);
  for (std::size_t b = 0; b < tooth.remains[0].table_size(); ++b) {
    const Index3 first = tooth.remains[0].brick_origin(b);
    std::array<std::array<float, kBrickVoxels>, 2> values;
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Index3 i = first + Index3(v >> 6, v >> 3 & 7, v & 7);
      const auto height = static_cast<float>(tooth.lattice.to_world(i).y()) - 0.43F;
      const float solid = tooth.solid.value(i.x(), i.y(), i.z());
      values[0][v] = std::max(solid, -height);
      values[1][v] = std::max(solid, height);
    }
    for (int k = 0; k < 2; ++k) tooth.remains[k].set_brick(b, values[k].data());
  }
  const SharpSurface surface = surface_by_tissue(tooth);
  const Edges border = tissue_borders(surface.mesh).at(0).edges;
  ASSERT_GT(border.size(), 60u);
  for (const double bound : {0.005, 0.04}) {
    SCOPED_TRACE(bound);
    const Decimation d = decimate(surface.mesh, surface.margin, bound);
    ASSERT_TRUE(d.decimated);
    expect_valid(d.mesh);
    ASSERT_EQ(d.mesh.triangle_tissue.size(), d.mesh.triangles.size());
    EXPECT_LT(d.mesh.triangles.size(), surface.mesh.triangles.size() / (bound < 0.01 ? 2 : 4));
    const std::vector<TissueBorder> borders = tissue_borders(d.mesh);
    ASSERT_EQ(borders.size(), 1u);
    EXPECT_LT(borders[0].edges.size(), border.size() / 2);
    const double there = line_distance(surface.mesh, border, d.mesh, borders[0].edges),
                 back = line_distance(d.mesh, borders[0].edges, surface.mesh, border);
    EXPECT_LE(std::max(there, back), bound + 1e-9);
    EXPECT_LE(there, d.greatest_of_lines_mm + 1e-9);
    EXPECT_LE(line_distance(surface.mesh, surface.margin, d.mesh, d.lines), bound + 1e-9);
  }
}

TEST(Decimation, IsTheSameBitsForAnyNumberOfThreads) {
  const SharpSurface surface = extract_sharp_surface(class2(0.15));
  const Decimation many = decimate(surface.mesh, surface.margin, 0.02);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const Decimation alone = decimate(surface.mesh, surface.margin, 0.02);
  EXPECT_EQ(many.mesh.vertices, alone.mesh.vertices);
  EXPECT_EQ(many.mesh.triangles, alone.mesh.triangles);
  EXPECT_EQ(many.mesh.tissue, alone.mesh.tissue);
  EXPECT_EQ(many.lines, alone.lines);
  EXPECT_EQ(many.greatest_mm, alone.greatest_mm);
}

TriangleMesh box(float half) {
  TriangleMesh m;
  for (int v = 0; v < 8; ++v)
    m.vertices.emplace_back(v & 1 ? half : -half, v & 2 ? half : -half, v & 4 ? half : -half);
  m.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                 {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  m.tissue.assign(8, 2);
  return m;
}

TEST(Decimation, RefusesBoundsWithoutSenseAndOpenMeshes) {
  TriangleMesh open = box(1);
  for (const double bound :
       {0.0, -1.0, 0.0009, 1.001, std::nan(""), std::numeric_limits<double>::infinity()})
    EXPECT_THROW((void)decimate(open, {}, bound), Error) << bound;
  open.triangles.pop_back();
  EXPECT_THROW((void)decimate(open, {}, 0.1), Error);
}

TEST(Decimation, WritesWhatCannotBeFewerAsItIs) {
  const TriangleMesh cube = box(1);
  const Decimation d = decimate(cube, {}, 0.01);
  EXPECT_EQ(d.mesh.triangles.size(), cube.triangles.size());
  EXPECT_LT(d.greatest_mm, 1e-12);
}

// A corner of the larger cube is sqrt(3) times the walls' distance from the smaller one.
TEST(SurfaceDistance, OfConcentricCubesIsThatOfTheCorners) {
  const TriangleMesh small = box(1), large = box(1.0625F);
  const TriangleTree to_small(small), to_large(large);
  const double corner = std::sqrt(3.0) / 16;
  EXPECT_NEAR(surface_distance(large, small, to_small, 0.2).greatest_mm, corner, 1e-6);
  EXPECT_TRUE(surface_distance(large, small, to_small, 1.001 * corner).beyond.empty());
  EXPECT_EQ(surface_distance(large, small, to_small, 0.999 * corner).beyond.size(), 12u);
  EXPECT_NEAR(surface_distance(small, large, to_large, 0.2).greatest_mm, 0.0625, 1e-6);
}

// A pyramid of height h on the middle of a wall, over a square of half width w about its centre: the
// middle of the plain wall, where it has no vertex, is h w / sqrt(h² + w²) from the pyramid.
TEST(SurfaceDistance, FindsWhatLiesBetweenTheVertices) {
  const TriangleMesh plain = box(1);
  TriangleMesh bump = plain;
  constexpr float kHalf = 0.0625F, kHeight = 0.25F;
  bump.triangles.erase(bump.triangles.begin() + 2, bump.triangles.begin() + 4);  // z = 1
  for (const auto& [x, y] : {std::array{-kHalf, -kHalf}, std::array{kHalf, -kHalf},
                             std::array{kHalf, kHalf}, std::array{-kHalf, kHalf}})
    bump.vertices.emplace_back(x, y, 1.0F);
  bump.vertices.emplace_back(0.0F, 0.0F, 1 + kHeight);
  const std::array<std::uint32_t, 4> rim = {4, 5, 7, 6};
  for (std::uint32_t k = 0; k < 4; ++k) {
    const std::uint32_t n = (k + 1) % 4;
    bump.triangles.push_back({rim[k], rim[n], 8 + k});
    bump.triangles.push_back({rim[n], 8 + n, 8 + k});
    bump.triangles.push_back({8 + k, 8 + n, 12});
  }
  bump.tissue.assign(13, 2);
  expect_valid(bump);
  const double middle = kHeight * kHalf / std::hypot(kHeight, kHalf);
  const TriangleTree to_bump(bump), to_plain(plain);
  EXPECT_EQ(surface_distance(plain, bump, to_bump, 0.95 * middle).beyond.size(), 2u);
  EXPECT_TRUE(surface_distance(plain, bump, to_bump, 1.05 * middle).beyond.empty());
  EXPECT_NEAR(surface_distance(bump, plain, to_plain, 1).greatest_mm, kHeight, 1e-6);
  EXPECT_EQ(surface_distance(bump, plain, to_plain, 0.2).beyond.size(), 4u);
}

}  // namespace
}  // namespace toothprep
