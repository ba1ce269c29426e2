#include <gtest/gtest.h>

#include <algorithm>

#include "toothprep/step/bur/bur_shapes.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/placement/own_frame.h"
#include "toothprep/tools/placement/path_check.h"

namespace toothprep {
namespace {

// 8 x 8 x 6 mm below the plane z = 0 of a frame in W: 2 mm of enamel, 3 mm of dentin, pulp below.
LayeredTooth layers(const Pose& pose) {
  const double voxel = 0.2;
  const auto box = [](const Vec3& x, double low, double high) {
    const Vec3 outside = Vec3(std::abs(x.x()) - 4, std::abs(x.y()) - 4,
                              std::abs(x.z() - 0.5 * (low + high)) - 0.5 * (high - low));
    return static_cast<float>(outside.cwiseMax(0).norm() + std::min(0.0, outside.maxCoeff()));
  };
  const auto sample = [&](const Vec3& w) {
    const Vec3 x = pose.to_local(w);
    ToothSample s;
    s.solid = box(x, -6, 0);
    s.tissue = {box(x, -2, 0), box(x, -5, -2), box(x, -6, -5)};
    if (s.solid < 0)
      s.label = x.z() > -2 ? Tissue::kEnamel : x.z() > -5 ? Tissue::kDentin : Tissue::kPulp;
    return s;
  };
  const Lattice lattice{Vec3::Zero(), voxel};
  const Vec3 middle = pose.to_world({0, 0, -3});
  const Index3 centre = lattice.to_index(middle).array().round().matrix().cast<int>();
  const Index3 reach = Index3::Constant(35);  // 7 mm: the half diagonal is 6.4
  return build_tooth(lattice, centre - reach, centre + reach, sample, true);
}

const Pose kPoses[] = {Pose{}, Pose{Vec3(3.03, -2.11, 7.77),
                                    Quat(Eigen::AngleAxisd(0.7, Vec3(1, 2, -0.5).normalized()))}};

// Straight down to `deepest` and up again, 4 mm/s, in the frame of the layers.
std::vector<HandleSample> plunge(const Pose& pose, double deepest, double x = 0.03,
                                 double y = 0.04) {
  std::vector<HandleSample> path;
  for (double z = 2; z > deepest - 1e-9; z -= 0.02) {
    HandleSample s;
    s.time = static_cast<double>(path.size()) * 0.005;
    s.pose = pose * Pose{Vec3(x, y, z), Quat::Identity()};
    path.push_back(s);
  }
  return path;
}

// Distances of planes are exact in a level set, but where three planes meet; 0.02 mm is a tenth of
// a voxel.
TEST(PathCheck, DepthsAndDistancesOnLayersAreThoseOfThePlanes) {
  const Bur bur = bur_from_shorthand("cylinder:D1.0xL4.0");
  for (const Pose& pose : kPoses) {
    const LayeredTooth tooth = layers(pose);
    const PathCheck check = check_path(tooth, pose, bur, plunge(pose, -3.1));
    EXPECT_NEAR(check.clearance_at_start, 2, 0.02);
    EXPECT_EQ(check.least_distance, 0);
    EXPECT_NEAR(check.deepest_below_surface, 3.1, 0.02);
    EXPECT_NEAR(check.deepest_below_dentin, 1.1, 0.02);
    ASSERT_TRUE(check.least_to_pulp);
    EXPECT_NEAR(*check.least_to_pulp, 1.9, 0.02);
    EXPECT_NEAR(pose.to_local(check.least_to_pulp_at).z(), -5, 0.2);
    const double area = units::kPi * 0.25;
    EXPECT_NEAR(check.removed[0], area * 2, 0.12 * area * 2);  // in cells: five across
    EXPECT_NEAR(check.removed[1], area * 1.1, 0.25 * area);    // and six deep
    EXPECT_EQ(check.shank_overlap, 0);
    for (const PathPlace& p : check.places) {
      const double tip = pose.to_local(p.tip).z();
      ASSERT_TRUE(p.below_surface && p.to_pulp && p.to_dentin);
      EXPECT_NEAR(*p.below_surface, -tip, 0.02);
      EXPECT_NEAR(*p.to_pulp, tip + 5, 0.02);
      if (tip > -2) {
        EXPECT_NEAR(*p.to_dentin, tip + 2, 0.02);
      }
    }
  }
}

TEST(PathCheck, ThePulpIsOpenedByAsMuchAsTheBurReachesThrough) {
  const Bur bur = bur_from_shorthand("ball:D1.2");
  for (const Pose& pose : kPoses) {
    const PathCheck check = check_path(layers(pose), pose, bur, plunge(pose, -5.3));
    ASSERT_TRUE(check.least_to_pulp);
    EXPECT_NEAR(*check.least_to_pulp, -0.3, 0.03);
  }
}

TEST(PathCheck, AShankThatIsWiderThanTheHeadMeetsTheToothWhenTheHeadIsIn) {
  const Bur bur = bur_from_shorthand("cylinder:D1.0xL1.0xS1.6");
  const Pose pose;
  const LayeredTooth tooth = layers(pose);
  EXPECT_EQ(check_path(tooth, pose, bur, plunge(pose, -0.9)).shank_overlap, 0);
  const PathCheck deep = check_path(tooth, pose, bur, plunge(pose, -2));
  EXPECT_GT(deep.shank_overlap, 0.2);        // a ring of 0.5 to 0.7 mm, 1 mm deep: 0.75 mm³
  EXPECT_NEAR(deep.shank_time, 0.75, 0.06);  // at z = -1, 3 mm down at 4 mm/s
}

TEST(PathCheck, APathBesideTheToothSaysHowFar) {
  const Bur bur = bur_from_shorthand("ball:D1.2");
  const Pose pose;
  const PathCheck check = check_path(layers(pose), pose, bur, plunge(pose, -2, 6));
  EXPECT_NEAR(check.least_distance, 6 - 4 - 0.6, 0.03);
  EXPECT_EQ(check.removed[0], 0);
}

}  // namespace
}  // namespace toothprep
