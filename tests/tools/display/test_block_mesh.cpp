// Blocks meshed apart are one surface.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "same_surface.h"
#include "slot.h"
#include "toothprep/proof/specimen/molar.h"

namespace toothprep::testing {
namespace {

std::vector<std::shared_ptr<const BlockMesh>> all_blocks(const LayeredTooth& tooth,
                                                         const LevelSet& cut) {
  BlockMesher mesher;
  std::vector<std::shared_ptr<const BlockMesh>> blocks;
  const BlockRange range = blocks_of(tooth.solid);
  for (std::size_t b = 0; b < range.size(); ++b)
    blocks.push_back(std::make_shared<BlockMesh>(mesher.mesh(tooth, cut, range.block(b))));
  return blocks;
}

DisplayMesh surface_by_blocks(const LayeredTooth& tooth) {
  return join_blocks(all_blocks(tooth, Workpiece(tooth).cut()));
}

TEST(BlockMesh, BlocksOfTheMolarJoinToItsSurface) {
  const LayeredTooth tooth = make_molar({.voxel = 0.2});
  const DisplayMesh blocks = surface_by_blocks(tooth);
  EXPECT_GT(blocks.triangles.size(), 10000u);
  EXPECT_TRUE(is_closed(blocks));
  EXPECT_EQ(euler_characteristic(blocks), 2);
  expect_same_surface(blocks, extract_surface(tooth, SurfaceOf::kAll));
}

// Noise has every case of a cell, in and across the planes that blocks share.
TEST(BlockMesh, BlocksOfNoiseJoinToOneClosedSurface) {
  LayeredTooth tooth = make_empty_tooth({.origin = Vec3(-3, 2, 7), .voxel = 0.1},
                                        Index3(-37, -5, 20), Index3(10, 37, 40));
  std::mt19937 random(7);
  std::uniform_real_distribution<float> value(-0.3f, 0.3f);
  for (std::size_t b = 0; b < tooth.solid.table_size(); ++b) {
    float* solid = tooth.solid.writable_brick(b);
    for (int v = 0; v < kBrickVoxels; ++v) solid[v] = value(random);
  }
  const DisplayMesh blocks = surface_by_blocks(tooth);
  EXPECT_TRUE(is_closed(blocks));
  expect_same_surface(blocks, extract_surface(tooth, SurfaceOf::kAll));
}

// Solid up to the last sample of its grids: the surface passes half-way to the air around them.
TEST(BlockMesh, ASolidThatFillsItsGridsIsClosedAllTheSame) {
  LayeredTooth tooth =
      make_empty_tooth({.origin = Vec3::Zero(), .voxel = 0.1}, Index3(8, 8, 8), Index3(47, 47, 47));
  const auto band = static_cast<float>(tooth.band());
  for (std::size_t b = 0; b < tooth.solid.table_size(); ++b) tooth.solid.set_uniform(b, -band);
  const DisplayMesh blocks = surface_by_blocks(tooth);
  EXPECT_TRUE(is_closed(blocks));
  EXPECT_EQ(euler_characteristic(blocks), 2);
  expect_same_surface(blocks, extract_surface(tooth, SurfaceOf::kAll));
  // 7 bricks of 8 voxels a side, samples 0 .. 55, each end half a voxel out: 5.6 mm.
  for (int axis = 0; axis < 3; ++axis) {
    float low = 1e9f, high = -1e9f;
    for (const auto& v : blocks.vertices)
      low = std::min(low, v[axis]), high = std::max(high, v[axis]);
    EXPECT_NEAR(high - low, 5.6, 1e-5);
  }
}

TEST(BlockMesh, AnEmptyToothHasNoSurface) {
  const LayeredTooth tooth =
      make_empty_tooth({.origin = Vec3::Zero(), .voxel = 0.1}, Index3::Zero(), Index3(40, 40, 40));
  const DisplayMesh blocks = surface_by_blocks(tooth);
  EXPECT_TRUE(blocks.vertices.empty());
  EXPECT_TRUE(blocks.triangles.empty());
}

// Both blocks of a shared vertex give it the same place, normal and tissue, so that it looks the
// same from either.
TEST(BlockMesh, NeighboursAgreeOnWhatTheyShare) {
  const LayeredTooth tooth = make_molar({.voxel = 0.2});
  const auto blocks = all_blocks(tooth, Workpiece(tooth).cut());
  std::map<Point, std::pair<Point, int>> seen;
  int shared = 0;
  for (const auto& b : blocks)
    for (std::size_t v = 0; v < b->mesh.vertices.size(); ++v) {
      const std::pair<Point, int> look = {point(b->mesh.normals[v]), b->mesh.tissue[v]};
      const auto [at, fresh] = seen.try_emplace(point(b->mesh.vertices[v]), look);
      shared += !fresh;
      EXPECT_EQ(at->second, look);
    }
  EXPECT_GT(shared, 100);
}

// A ball's normals are its radii. Central differences of |x| over D err by (D/R)²/6 of the slope at
// most, 0.0004 here, and the linear blend along an edge by as much: 0.1 degrees.
TEST(BlockMesh, NormalsOfABallAreItsRadii) {
  const double radius = 2, voxel = 0.1;
  const Vec3 centre(0.03, -0.02, 0.01);
  const LayeredTooth tooth = build_tooth(
      {.origin = Vec3::Zero(), .voxel = voxel}, Index3::Constant(-25), Index3::Constant(25),
      [&](const Vec3& x) {
        ToothSample s;
        s.solid = static_cast<float>((x - centre).norm() - radius);
        s.tissue = {s.solid, 1, 1};
        s.label = s.solid < 0 ? Tissue::kEnamel : Tissue::kAir;
        return s;
      },
      true);
  const DisplayMesh mesh = surface_by_blocks(tooth);
  ASSERT_GT(mesh.vertices.size(), 5000u);
  double worst = 1;
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    EXPECT_NEAR(mesh.normals[v].norm(), 1, 1e-5);
    const Vec3 radial = (mesh.vertices[v].cast<double>() - centre).normalized();
    worst = std::min(worst, radial.dot(mesh.normals[v].cast<double>()));
  }
  EXPECT_GT(worst, std::cos(0.1 * 3.14159265 / 180));
}

TEST(BlockMesh, ASampleTouchesTheBlocksThatReadIt) {
  const BlockRange all{Index3(-2, -2, -2), Index3(5, 5, 5)};
  const auto along_x = [&](int low, int high) {
    const BlockRange r = blocks_touched(all, Index3(low, 10, 10), Index3(high, 10, 10));
    return std::pair(r.first.x(), r.counts.x());
  };
  EXPECT_EQ(along_x(10, 20), std::pair(0, 1));  // in the middle of block 0
  EXPECT_EQ(along_x(31, 31), std::pair(0, 2));  // block 1's sample -1, for its gradients
  EXPECT_EQ(along_x(32, 32), std::pair(0, 2));  // the shared plane
  EXPECT_EQ(along_x(33, 33), std::pair(0, 2));  // block 0's sample 33, for its gradients
  EXPECT_EQ(along_x(34, 34), std::pair(1, 1));
  EXPECT_EQ(along_x(-1, -1), std::pair(-1, 2));
  EXPECT_EQ(along_x(-500, -300), std::pair(0, 0));
}

}  // namespace
}  // namespace toothprep::testing
