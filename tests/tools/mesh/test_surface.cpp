// A surface must be fit for printing, scoring and collision: closed, 2-manifold, oriented outward,
// no triangle through another. CGAL, with exact predicates, is the judge, and reads the files back.
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/IO/PLY.h>
#include <CGAL/Polygon_mesh_processing/IO/polygon_mesh_io.h>
#include <CGAL/Polygon_mesh_processing/measure.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Surface_mesh.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <set>
#include <sstream>

#include "surfaces.h"
#include "toothprep/proof/specimen/block.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/mesh/surface.h"

namespace toothprep {
namespace {

namespace pmp = CGAL::Polygon_mesh_processing;

using surfaces::box_distance;
using surfaces::expect_valid;
using surfaces::judged;
using surfaces::Mesh;
using surfaces::Point;
using surfaces::tooth_of;
using units::kPi;

// A cylinder of radius r from `a` on in direction `u` for ever, its end flat.
double cutter_distance(const Vec3& x, const Vec3& a, const Vec3& u, double r) {
  const double along = (x - a).dot(u.normalized());
  return std::max((x - a - along * u.normalized()).norm() - r, -along);
}

double uniform(std::uint64_t seed) {  // splitmix64, 0..1
  seed += 0x9e3779b97f4a7c15ULL;
  seed = (seed ^ seed >> 30) * 0xbf58476d1ce4e5b9ULL;
  seed = (seed ^ seed >> 27) * 0x94d049bb133111ebULL;
  return static_cast<double>((seed ^ seed >> 31) >> 11) * 0x1p-53;
}

// Both volumes are of second order in the voxel, with errors of opposite sign (the mesh is
// inscribed in convex parts and bevels creases), so this holds to a fraction of (voxel / size)^2.
void expect_volume_of_level_set(const LayeredTooth& tooth, SurfaceOf what, double tolerance) {
  const double voxel = tooth.lattice.voxel;
  const double expected = what == SurfaceOf::kAll
                              ? volume_mm3(tooth.solid, voxel)
                              : volume_mm3(tooth.remains[static_cast<int>(what) - 1], voxel);
  EXPECT_NEAR(mesh_volume_mm3(extract_surface(tooth, what)) / expected, 1, tolerance);
}

TEST(Surface, OfABlockIsValidAndHasItsVolume) {
  const LayeredTooth tooth = make_block({});
  const TriangleMesh surface = extract_surface(tooth, SurfaceOf::kAll);
  expect_valid(surface);
  // Marching cubes bevels the twelve edges of 8 mm by a triangle of half a voxel's legs, 1/8 D^2
  // each.
  EXPECT_NEAR(mesh_volume_mm3(surface), 512 - 12 * 8 * 0.01 / 8, 0.01);
  expect_volume_of_level_set(tooth, SurfaceOf::kAll, 1e-3);
}

TEST(Surface, OfEachTissueIsValidAndHasItsVolume) {
  BlockOptions o;
  o.size = Vec3(3, 4, 3);
  o.enamel = 1.23;
  o.voxel = 0.05;
  o.pose.orientation = orientation_of_axis(Vec3(0.3, -0.5, 1), 0.7);
  const LayeredTooth tooth = make_block(o);
  for (const SurfaceOf what : {SurfaceOf::kEnamel, SurfaceOf::kDentin}) {
    const TriangleMesh surface = extract_surface(tooth, what);
    expect_valid(surface);
    expect_volume_of_level_set(tooth, what, 5e-3);
    for (const auto label : surface.tissue) ASSERT_EQ(label, static_cast<int>(what));
  }
  EXPECT_TRUE(extract_surface(tooth, SurfaceOf::kPulp).triangles.empty());
}

TEST(Surface, OfATurnedBlockFarFromTheOriginIsValid) {
  BlockOptions o;
  o.size = Vec3(3, 2, 2.5);
  o.enamel = 1;
  o.pose.position = Vec3(-250, 180, -1234.5);  // where a scanner's frame may put a tooth
  o.pose.orientation = orientation_of_axis(Vec3(1, 2, 3), 0.3);
  const LayeredTooth tooth = make_block(o);
  expect_valid(extract_surface(tooth, SurfaceOf::kAll));
  expect_volume_of_level_set(tooth, SurfaceOf::kAll, 5e-3);
}

TEST(Surface, OfABallConvergesWithTheSquareOfTheVoxel) {
  const double r = 2;
  std::vector<double> errors;
  for (const double voxel : {0.2, 0.1}) {
    const LayeredTooth ball = tooth_of(
        [r](const Vec3& x) { return (x - Vec3(0.013, 0.027, -0.041)).norm() - r; }, r, voxel);
    const TriangleMesh surface = extract_surface(ball, SurfaceOf::kAll);
    expect_valid(surface);
    expect_volume_of_level_set(ball, SurfaceOf::kAll, voxel * voxel / (r * r));
    errors.push_back(std::abs(mesh_volume_mm3(surface) - 4 * kPi / 3 * r * r * r));
    for (const auto& v :
         surface.vertices)  // second order along an edge, plus the margin at its ends
      ASSERT_NEAR((v.cast<double>() - Vec3(0.013, 0.027, -0.041)).norm(), r,
                  voxel * voxel / (8 * r) * 3 + 0.02 * voxel);
  }
  EXPECT_NEAR(errors[0] / errors[1], 4, 0.5);
}

TEST(Surface, OfASlotWithSharpCreasesIsValid) {
  // What the step leaves: max(phi, -d) of a flat-ended cylinder, along and across the lattice.
  for (const Vec3& axis : {Vec3(0, 0, 1), Vec3(0.2, -0.3, 1)}) {
    const LayeredTooth cut = tooth_of(
        [&](const Vec3& x) {
          double phi = box_distance(x, Vec3(2, 2, 2));
          for (int i = 0; i <= 30; ++i)
            phi = std::max(
                phi, -cutter_distance(x, Vec3(-0.5 + 0.1 * i, 0.3 - 0.02 * i, 0.13), axis, 0.6));
          return phi;
        },
        2, 0.05);
    expect_valid(extract_surface(cut, SurfaceOf::kAll));
    expect_volume_of_level_set(cut, SurfaceOf::kAll, 5e-3);
  }
}

TEST(Surface, OfThinWallsBetweenPassesIsValid) {
  // Walls thinner than a voxel at any angle: the ambiguous cases of marching cubes.
  const LayeredTooth walls = tooth_of(
      [](const Vec3& x) {
        const double a = std::abs(std::remainder(x.dot(Vec3(0.7, 0.5, 0.2).normalized()), 0.4));
        const double b = std::abs(std::remainder(x.dot(Vec3(-0.3, 0.8, 0.5).normalized()), 0.53));
        return std::max(box_distance(x, Vec3(1, 1, 1)), std::min(a, b) - 0.04);
      },
      1, 0.1);
  expect_valid(extract_surface(walls, SurfaceOf::kAll));
}

TEST(Surface, OfNoiseIsValidInEveryCase) {
  // Independent signs at every voxel make all 256 cases; magnitudes over three decades push
  // vertices to the ends of their edges.
  const LayeredTooth noise = tooth_of(
      [](const Vec3& x) {
        const auto i = static_cast<std::uint64_t>(std::lround(x.x() / 0.1) + 64) << 16 |
                       static_cast<std::uint64_t>(std::lround(x.y() / 0.1) + 64) << 8 |
                       static_cast<std::uint64_t>(std::lround(x.z() / 0.1) + 64);
        const double magnitude = 0.3 * std::pow(10, -3 * uniform(2 * i));
        return uniform(2 * i + 1) < 0.5 ? -magnitude : magnitude;
      },
      1.0, 0.1);
  const auto inside = [&](int x, int y, int z) { return noise.solid.value(x, y, z) < 0; };
  std::set<int> cases;
  for (int x = -10; x < 10; ++x)
    for (int y = -10; y < 10; ++y)
      for (int z = -10; z < 10; ++z) {
        int c = 0;
        for (int b = 0; b < 8; ++b) c |= inside(x + (b & 1), y + (b >> 1 & 1), z + (b >> 2)) << b;
        cases.insert(c);
      }
  ASSERT_EQ(cases.size(), 256u);
  expect_valid(extract_surface(noise, SurfaceOf::kAll));
}

TEST(Surface, TheJudgeOfTheseTestsFindsIntersections) {
  TriangleMesh surface = extract_surface(make_block({}), SurfaceOf::kAll);
  for (std::size_t v = 0; v < surface.vertices.size(); v += 2)
    surface.vertices[v] += Eigen::Vector3f(0.15F, 0.1F, 0);
  EXPECT_TRUE(pmp::does_self_intersect(judged(surface)));
}

TEST(Surface, ClosesAlsoWhereTheSolidReachesTheEdgeOfItsGrid) {
  LayeredTooth tooth = make_empty_tooth({}, Index3::Zero(), Index3::Zero());
  for (std::size_t b = 0; b < tooth.solid.table_size(); ++b) tooth.solid.set_uniform(b, -0.3F);
  const TriangleMesh surface = extract_surface(tooth, SurfaceOf::kAll);
  expect_valid(surface);
  const double side =
      24 * 0.1;  // three bricks; the background is as far outside as the inside is deep
  EXPECT_NEAR(mesh_volume_mm3(surface), side * side * side, 0.05);
}

TEST(Surface, IsEmptyWhenNothingRemains) {
  const TriangleMesh surface =
      extract_surface(make_empty_tooth({}, Index3::Zero(), Index3::Constant(9)), SurfaceOf::kAll);
  EXPECT_TRUE(surface.vertices.empty());
  EXPECT_TRUE(surface.triangles.empty());
  EXPECT_EQ(mesh_volume_mm3(surface), 0);
}

TEST(Surface, VerticesCarryTheTissueUnderThem) {
  const LayeredTooth block = make_block({});  // enamel down to y = -2
  const TriangleMesh surface = extract_surface(block, SurfaceOf::kAll);
  for (std::size_t v = 0; v < surface.vertices.size(); ++v) {
    const double y = surface.vertices[v].y();
    if (std::abs(y + 2) > 0.1) {
      ASSERT_EQ(static_cast<Tissue>(surface.tissue[v]), y > -2 ? Tissue::kEnamel : Tissue::kDentin)
          << "at y = " << y;
    }
  }
}

TEST(Surface, IsTheSameToTheBitWhateverTheThreads) {
  const LayeredTooth block = make_block({});
  const TriangleMesh a = extract_surface(block, SurfaceOf::kAll);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const TriangleMesh b = extract_surface(block, SurfaceOf::kAll);
  EXPECT_EQ(a.vertices, b.vertices);
  EXPECT_EQ(a.triangles, b.triangles);
  EXPECT_EQ(a.tissue, b.tissue);
}

class MeshFile : public testing::Test {
 protected:
  MeshFile() {
    BlockOptions o;
    o.size = Vec3(1, 1.5, 1);
    o.enamel = 0.5;
    o.pose.position = Vec3(12.34567, -98.7654, 3.21);
    surface_ = extract_surface(make_block(o), SurfaceOf::kAll);
    folder_ = std::filesystem::path(testing::TempDir()) /
              testing::UnitTest::GetInstance()->current_test_info()->name();
    std::filesystem::create_directories(folder_);
  }
  ~MeshFile() override { std::filesystem::remove_all(folder_); }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  TriangleMesh surface_;
  std::filesystem::path folder_;
};

TEST_F(MeshFile, IsReadByCgalInEveryFormat) {
  for (const char* name : {"m.ply", "m.stl", "m.obj", "M.PLY"}) {
    write_mesh(surface_, path(name));
    // CGAL recognises formats by lower-case names.
    const std::string lower =
        path("lower." + std::string(name == std::string("M.PLY") ? "ply" : name + 2));
    std::filesystem::rename(path(name), lower);
    Mesh mesh;
    ASSERT_TRUE(pmp::IO::read_polygon_mesh(lower, mesh)) << name;
    EXPECT_EQ(num_vertices(mesh), surface_.vertices.size()) << name;
    EXPECT_EQ(num_faces(mesh), surface_.triangles.size()) << name;
    EXPECT_TRUE(CGAL::is_closed(mesh)) << name;
    EXPECT_TRUE(pmp::is_outward_oriented(mesh)) << name;
    EXPECT_NEAR(pmp::volume(mesh), mesh_volume_mm3(surface_), 1e-9 * 100 * 100) << name;
    std::filesystem::remove(lower);
  }
}

TEST_F(MeshFile, PlyCarriesTheTissueOfEachVertex) {
  write_mesh(surface_, path("m.ply"));
  std::ifstream in(path("m.ply"), std::ios::binary);
  std::vector<Point> points;
  std::vector<std::vector<std::size_t>> faces;
  ASSERT_TRUE(CGAL::IO::read_PLY(in, points, faces));
  std::ifstream again(path("m.ply"), std::ios::binary);
  Mesh mesh;
  ASSERT_TRUE(CGAL::IO::read_PLY(again, mesh));
  const auto tissue = mesh.property_map<Mesh::Vertex_index, std::uint8_t>("v:tissue").first;
  std::size_t i = 0;
  for (const auto v : mesh.vertices()) {
    ASSERT_EQ(tissue[v], surface_.tissue[i]);
    ASSERT_EQ(mesh.point(v).x(), surface_.vertices[i].x()) << "floats are kept to the bit";
    ++i;
  }
}

TEST_F(MeshFile, RefusesOtherFormatsAndEmptySurfaces) {
  EXPECT_THROW(write_mesh(surface_, path("m.glb")), Error);
  EXPECT_THROW(write_mesh(surface_, path("m")), Error);
  EXPECT_THROW(write_mesh(TriangleMesh{}, path("m.ply")), Error);
  EXPECT_THROW(write_mesh(surface_, path("absent/m.ply")), Error);
  EXPECT_TRUE(std::filesystem::is_empty(folder_));
}

}  // namespace
}  // namespace toothprep
