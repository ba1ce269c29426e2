// The layered block: its volumes and faces are known exactly.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "toothprep/proof/specimen/block.h"
#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

constexpr int kEnamel = tissue_index(Tissue::kEnamel), kDentin = tissue_index(Tissue::kDentin),
              kPulp = tissue_index(Tissue::kPulp), kOther = tissue_index(Tissue::kOther);

// Trilinear value of a level set at a world position.
template <class Grid>
double value_at(const Grid& grid, const Lattice& lattice, const Vec3& x) {
  const Vec3 index = lattice.to_index(x);
  const Index3 i = index.array().floor().matrix().cast<int>();
  const Vec3 f = index - i.cast<double>();
  double sum = 0;
  for (int c = 0; c < 8; ++c) {
    const Index3 step(c & 1, (c >> 1) & 1, c >> 2);
    double weight = 1;
    for (int a = 0; a < 3; ++a) weight *= step[a] ? f[a] : 1 - f[a];
    sum += weight * grid.value(i.x() + step.x(), i.y() + step.y(), i.z() + step.z());
  }
  return sum;
}

Tissue label_at(const LayeredTooth& tooth, const Vec3& x) {
  const Index3 i = tooth.lattice.to_index(x).array().round().matrix().cast<int>();
  return static_cast<Tissue>(tooth.tissue.value(i.x(), i.y(), i.z()));
}

TEST(Block, HasTheVolumesOfItsLayers) {
  const auto volume = remaining_volumes_mm3(make_block({}));
  // 8 x 8 mm: 2 mm of enamel, 6 mm of dentin. Faces between voxel centres make the sum exact but
  // for the rounding of the level set to float.
  EXPECT_NEAR(volume[kEnamel], 8 * 8 * 2, 1e-3);
  EXPECT_NEAR(volume[kDentin], 8 * 8 * 6, 1e-3);
  EXPECT_EQ(volume[kPulp], 0);
  EXPECT_EQ(volume[kOther], 0);
}

TEST(Block, MayHaveThreeEdgesAndAnyVoxel) {
  BlockOptions o;
  o.size = {5, 4, 3};
  o.enamel = 1.5;
  for (const double voxel : {0.1, 0.13, 0.07}) {
    o.voxel = voxel;
    const LayeredTooth tooth = make_block(o);
    const auto volume = remaining_volumes_mm3(tooth);
    // Where an edge is not a whole number of voxels, the voxels along edges are off by second
    // order: less than voxel²/4 per mm of edge.
    const double edges = 4 * (5 + 4 + 3) * voxel * voxel / 4;
    EXPECT_NEAR(volume[kEnamel], 5 * 3 * 1.5, edges) << voxel;
    EXPECT_NEAR(volume[kDentin], 5 * 3 * 2.5, edges) << voxel;
  }
}

TEST(Block, KeepsItsVolumesWhenTurned) {
  BlockOptions o;
  o.pose.orientation = Quat(Eigen::AngleAxisd(0.7, Vec3(1, 2, 3).normalized()));
  o.pose.position = {3.21, -4.56, 7.89};
  const auto volume = remaining_volumes_mm3(make_block(o));
  EXPECT_NEAR(volume[kEnamel], 128, 128e-3);
  EXPECT_NEAR(volume[kDentin], 384, 384e-3);
}

TEST(Block, HasItsFacesWhereTheyWereAskedFor) {
  BlockOptions o;
  o.enamel = 1.97;  // not a whole number of voxels
  const LayeredTooth tooth = make_block(o);
  const auto solid = [&](double x, double y, double z) {
    return value_at(tooth.solid, tooth.lattice, {x, y, z});
  };
  const auto enamel = [&](double y) {
    return value_at(tooth.remains[0], tooth.lattice, {0.3, y, -0.7});
  };
  constexpr double kRounding = 1e-5;
  EXPECT_NEAR(solid(0.3, 0, -0.7), 0, kRounding);
  EXPECT_NEAR(solid(0.3, 0.12, -0.7), 0.12, kRounding);
  EXPECT_NEAR(solid(0.3, -0.12, -0.7), -0.12, kRounding);
  EXPECT_NEAR(solid(0.3, -8, -0.7), 0, kRounding);
  EXPECT_NEAR(solid(4, -3.3, -0.7), 0, kRounding);
  EXPECT_NEAR(solid(-4, -3.3, -0.7), 0, kRounding);
  EXPECT_NEAR(solid(0.3, -3.3, 4.05), 0.05, kRounding);
  EXPECT_NEAR(solid(0.3, -3.3, -4.05), 0.05, kRounding);
  EXPECT_NEAR(enamel(-1.97), 0, kRounding);
  EXPECT_NEAR(enamel(-1.9), -0.07, kRounding);
  EXPECT_NEAR(value_at(tooth.remains[1], tooth.lattice, {0.3, -1.9, -0.7}), 0.07, kRounding);
}

TEST(Block, LabelsItsLayers) {
  const LayeredTooth tooth = make_block({});
  EXPECT_EQ(label_at(tooth, {0, 0.05, 0}), Tissue::kAir);
  EXPECT_EQ(label_at(tooth, {0, -0.05, 0}), Tissue::kEnamel);
  EXPECT_EQ(label_at(tooth, {3.95, -1.95, -3.95}), Tissue::kEnamel);
  EXPECT_EQ(label_at(tooth, {3.95, -2.05, -3.95}), Tissue::kDentin);
  EXPECT_EQ(label_at(tooth, {0, -7.95, 0}), Tissue::kDentin);
  EXPECT_EQ(label_at(tooth, {0, -8.05, 0}), Tissue::kAir);
  EXPECT_EQ(label_at(tooth, {4.05, -1, 0}), Tissue::kAir);
}

TEST(Block, MayBeAllDentinOrAllEnamel) {
  BlockOptions o;
  o.size = {4, 4, 4};
  o.enamel = 0;
  auto volume = remaining_volumes_mm3(make_block(o));
  EXPECT_EQ(volume[kEnamel], 0);
  EXPECT_NEAR(volume[kDentin], 64, 1e-3);
  o.enamel = 4;
  volume = remaining_volumes_mm3(make_block(o));
  EXPECT_NEAR(volume[kEnamel], 64, 1e-3);
  EXPECT_EQ(volume[kDentin], 0);
}

TEST(Block, RefusesWhatCannotBeABlock) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  const auto refused = [](auto change) {
    BlockOptions o;
    change(o);
    EXPECT_THROW(static_cast<void>(make_block(o)), Error);
  };
  for (const double bad : {0.0, -1.0, 1e6, nan, infinity})
    refused([&](BlockOptions& o) { o.size.y() = bad; });
  for (const double bad : {-0.1, 8.1, nan, infinity})
    refused([&](BlockOptions& o) { o.enamel = bad; });
  for (const double bad : {0.0, -0.1, 5.0, 1e-6, nan, infinity})
    refused([&](BlockOptions& o) { o.voxel = bad; });
}

}  // namespace
}  // namespace toothprep
