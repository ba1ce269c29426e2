// Deviations of the prepared from the target surface, where they are known.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cstdio>
#include <numeric>

#include "cut_teeth.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/tooth/level_at.h"
#include "toothprep/tools/compare/cut_surface.h"
#include "toothprep/tools/compare/deviation.h"
#include "toothprep/tools/shells/shells.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

Shape placed(const Shape& shape, const Pose& pose) {
  return [=](const Vec3& x) { return shape(pose.to_local(x)); };
}

TEST(CutSurface, SamplesALinearFieldExactly) {
  // Trilinear interpolation reproduces a + b·x to the rounding of the stored floats.
  const Vec3 slope(0.3, -0.5, 0.2);
  const LayeredTooth tooth = build_tooth(
      {Vec3(0.1, 0.2, 0.3), 0.1}, Index3::Constant(-9), Index3::Constant(9),
      [&](const Vec3& x) {
        ToothSample s;
        s.solid = static_cast<float>(0.2 * slope.dot(x));
        return s;
      },
      false);
  for (const Vec3& x : {Vec3(0.123, 0.456, 0.011), Vec3(-0.31, 0.2, 0.3), Vec3(0.1, 0.2, 0.3)})
    EXPECT_NEAR(level_at(tooth.solid, tooth.lattice, x), 0.2 * slope.dot(x), 1e-7);
  EXPECT_EQ(level_at(tooth.solid, tooth.lattice, Vec3(1e30, 0, 0)), tooth.solid.background());
}

TEST(CutSurface, DepthIsZeroOnTheOriginalSurfaceAndTheTrueDepthInACut) {
  const double voxel = 0.1;
  const LayeredTooth tooth = block(voxel, odd_pose());
  // 2 % of a voxel: how far a vertex of extract_surface may lie from the zero of its edge.
  for (const float d : depth_inside(extract_surface(tooth, SurfaceOf::kAll), tooth))
    ASSERT_NEAR(d, 0, 0.02 * voxel + 1e-6);
  const LayeredTooth cut =
      carved(tooth, placed(box_shape(Vec3(-1.5, -0.25, -1), Vec3(1.5, 1, 1)), odd_pose()));
  const TriangleMesh surface = extract_surface(cut, SurfaceOf::kAll);
  const std::vector<float> depth = depth_inside(surface, tooth);
  double area = 0, floor_area = 0;
  const std::vector<double> areas = vertex_areas(surface);
  for (std::size_t v = 0; v < depth.size(); ++v) {
    const double y = odd_pose().to_local(surface.vertices[v].cast<double>()).y();
    if (depth[v] > cut_tolerance(tooth.lattice)) {
      area += areas[v];
      EXPECT_NEAR(depth[v], -y, 0.02);  // below the top face
    }
    if (depth[v] > 0.24) floor_area += areas[v];
  }
  EXPECT_NEAR(floor_area, 3 * 2, 0.1 * 3 * 2);              // its rim is bevelled within a voxel
  EXPECT_NEAR(area, 3 * 2 + 10 * (0.25 - 0.05), 0.05 * 8);  // and the walls below the tolerance
}

struct Offset {
  double voxel, offset;
};
class OffsetShell : public ::testing::TestWithParam<Offset> {};

TEST_P(OffsetShell, DeviatesByTheOffsetWithinTwoHundredthsOfAMillimetre) {
  // Hollows of radius 2 mm (target) and 2 mm + offset (prepared) about a point of the top face: a
  // shell. Every point of the prepared hollow lies `offset` from the target, but for the rim,
  // where the target's top face may be nearer (a band as high as the offset).
  const auto [voxel, offset] = GetParam();
  const Pose pose = odd_pose();
  const LayeredTooth tooth = block(voxel, pose);
  const Solid original = solid_of("original", tooth);
  const Vec3 centre = pose.position;
  const Solid target =
      on_lattice(solid_of("target", carved(tooth, ball_shape(centre, 2))), original);
  const Solid prepared =
      on_lattice(solid_of("prepared", carved(tooth, ball_shape(centre, 2 + offset))), original);
  const Deviation d = measure_deviation(original, prepared, target);
  double worst = 0;
  for (std::size_t v = 0; v < d.per_vertex.size(); ++v) {
    const Vec3 x = pose.to_local(prepared.surface.vertices[v].cast<double>());
    if (std::isnan(d.per_vertex[v]) || x.y() > -std::abs(offset) - 2 * voxel) continue;
    worst = std::max(worst, std::abs(d.per_vertex[v] + offset));
  }
  EXPECT_LT(worst, 0.02);
  EXPECT_NEAR(d.mean_mm, -offset, 0.02);
  EXPECT_NEAR(d.rms_mm, std::abs(offset), 0.02);
  EXPECT_NEAR(d.p95_mm, std::abs(offset), 0.02);
  EXPECT_NEAR(d.hausdorff_mm, std::abs(offset), 0.02 + 0.5 * voxel);  // bevels at the rim
  EXPECT_EQ(d.share_within_0_2 > 0.99, std::abs(offset) < 0.19);
  const double area =
      std::accumulate(d.histogram.begin(), d.histogram.end(), 0.0,
                      [](double sum, const DeviationBin& bin) { return sum + bin.area_mm2; });
  EXPECT_NEAR(area, d.area_mm2, 1e-9 * area);
  std::printf(
      "voxel %.2f offset %+.2f: mean %+.4f rms %.4f p95 %.4f hausdorff %.4f, worst off the "
      "rim %.4f mm\n",
      voxel, offset, d.mean_mm, d.rms_mm, d.p95_mm, d.hausdorff_mm, worst);
}
INSTANTIATE_TEST_SUITE_P(Offsets, OffsetShell,
                         ::testing::Values(Offset{0.1, 0.1}, Offset{0.1, -0.1}, Offset{0.1, 0.3},
                                           Offset{0.05, 0.05}));

TEST(OnLattice, KeepsTheCutOfAToothOnTheSameLatticeAndOnlyThere) {
  const LayeredTooth tooth = molar(0.2);
  LayeredTooth prepared = tooth;
  const auto band = static_cast<float>(tooth.band());
  LevelSet cut(tooth.solid.first_brick(), tooth.solid.brick_counts(), -band, {band});
  const Shape shape = class_one();
  std::array<float, kBrickVoxels> values;
  for (std::size_t b = 0; b < cut.table_size(); ++b) {
    for (int v = 0; v < kBrickVoxels; ++v)
      values[v] = static_cast<float>(std::clamp<double>(
          -shape(tooth.lattice.to_world(cut.brick_origin(b) + Index3(v >> 6, v >> 3 & 7, v & 7))),
          -band, band));
    cut.set_brick(b, values.data());
  }
  apply_cut(prepared, cut);
  const Solid original = solid_of("original", tooth), given = solid_of("prepared", prepared);
  const Solid laid = on_lattice(given, original);
  ASSERT_TRUE(laid.tooth.parts);
  int inside_cut = 0;
  for (std::size_t b = 0; b < cut.table_size(); ++b) {
    const Index3 first = cut.brick_origin(b);
    for (int v = 0; v < kBrickVoxels; v += 7) {
      const Index3 i = first + Index3(v >> 6, v >> 3 & 7, v & 7);
      const float is = laid.tooth.parts->cut.value(i.x(), i.y(), i.z());
      ASSERT_EQ(is, prepared.parts->cut.value(i.x(), i.y(), i.z())) << i.transpose();
      ASSERT_EQ(laid.tooth.parts->intact.value(i.x(), i.y(), i.z()),
                tooth.solid.value(i.x(), i.y(), i.z()))
          << i.transpose();
      inside_cut += is < 0;
    }
  }
  EXPECT_GT(inside_cut, 100);
  EXPECT_FALSE(on_lattice(given, original, odd_pose()).tooth.parts);
}

TEST(Deviation, OfEqualSurfacesIsZero) {
  const LayeredTooth tooth = molar(0.2);
  const Solid original = solid_of("original", tooth);
  const Solid cut = on_lattice(solid_of("cut", carved(tooth, class_one())), original);
  const Deviation d = measure_deviation(original, cut, cut);
  EXPECT_NEAR(d.rms_mm, 0, 1e-5);
  EXPECT_NEAR(d.hausdorff_mm, 0, 1e-5);
  EXPECT_EQ(d.share_within_0_1, 1);
}

TEST(Deviation, FindsWhatTheTargetHasAndThePreparationHasNot) {
  // The target has two holes, the preparation only the first: none of its cut deviates, but 1.5 mm
  // deep material stands in the second, in the middle of a hole 2 mm across.
  const LayeredTooth tooth = block(0.1);
  const Solid original = solid_of("original", tooth);
  const Shape first = box_shape(Vec3(-3, -2, -1), Vec3(-1, 1, 1)),
              second = box_shape(Vec3(1, -1.5, -1), Vec3(3, 1, 1));
  const Solid prepared = on_lattice(solid_of("prepared", carved(tooth, first)), original);
  const Solid target = on_lattice(
      solid_of("target",
               carved(tooth, [&](const Vec3& x) { return std::min(first(x), second(x)); })),
      original);
  const Deviation d = measure_deviation(original, prepared, target);
  // The middle of the missing hole's mouth is 1 mm from its walls, the vertices nearest to it half
  // a voxel less; its floor is 1.5 mm down.
  EXPECT_NEAR(d.most_mm, 0.95, 0.01);
  EXPECT_NEAR(d.to_target_mm, 0.95, 0.01);
  EXPECT_NEAR(d.to_prepared_mm, 1.5, 0.01);
  EXPECT_NEAR(d.hausdorff_mm, 1.5, 0.01);
  EXPECT_GT(d.mean_mm, 0);
  EXPECT_NEAR(d.least_mm, 0, 1e-5);
}

TEST(Deviation, OfAMeshPreparationIsThatOfItsVoxels) {
  // The same hollow, given as a mesh in place of voxels, read back from its triangles.
  const LayeredTooth tooth = block(0.1, odd_pose());
  const Solid original = solid_of("original", tooth);
  const Solid target =
      on_lattice(solid_of("target", carved(tooth, ball_shape(odd_pose().position, 2))), original);
  const Solid voxels = on_lattice(
      solid_of("prepared", carved(tooth, ball_shape(odd_pose().position, 2.1))), original);
  Solid mesh = voxels;
  mesh.layered = false;
  mesh.tooth = block(0.1);  // another lattice: the mesh is voxelized anew
  mesh.tooth.lattice.origin += Vec3(0.013, 0.02, 0.03);
  const Solid again = on_lattice(mesh, original);
  // Its voxels are those it was made of, but for D²/8 that the mesh bevels off each mm of its
  // creases: 12 edges of 8 mm, and the mouth.
  EXPECT_NEAR(volume_mm3(again.tooth.solid, 0.1), volume_mm3(voxels.tooth.solid, 0.1),
              (12 * 8 + 13) * 0.1 * 0.1 / 8);
  EXPECT_NEAR(volume_mm3(again.tooth.solid, 0.1), volume_mm3(voxels.tooth.solid, 0.1),
              5e-4 * volume_mm3(voxels.tooth.solid, 0.1));
  EXPECT_NEAR(remaining_volumes_mm3(again.tooth)[0], remaining_volumes_mm3(voxels.tooth)[0],
              1e-3 * remaining_volumes_mm3(voxels.tooth)[0]);
  EXPECT_NEAR(measure_deviation(original, again, target).mean_mm,
              measure_deviation(original, voxels, target).mean_mm, 1e-6);
}

TEST(Deviation, IsTheSameBitsForAnyNumberOfThreads) {
  const LayeredTooth tooth = block(0.1, odd_pose());
  const Solid original = solid_of("original", tooth);
  const Solid target =
      on_lattice(solid_of("target", carved(tooth, ball_shape(odd_pose().position, 2))), original);
  const Solid prepared = on_lattice(
      solid_of("prepared", carved(tooth, ball_shape(odd_pose().position, 2.1))), original);
  const Deviation many = measure_deviation(original, prepared, target);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const Deviation single = measure_deviation(original, prepared, target);
  EXPECT_EQ(many.mean_mm, single.mean_mm);
  EXPECT_EQ(many.hausdorff_mm, single.hausdorff_mm);
}

TEST(Deviation, OfAnUncutToothIsRefused) {
  const LayeredTooth tooth = block(0.2);
  const Solid original = solid_of("original", tooth);
  EXPECT_THAT([&] { measure_deviation(original, original, original); },
              ThrowsMessage<InputError>(HasSubstr("cut")));
}

}  // namespace
}  // namespace toothprep
