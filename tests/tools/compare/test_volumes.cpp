// Volumes of regions between teeth, against cavities whose volumes are known exactly; and what is
// no preparation of the given tooth.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cstdio>

#include "cut_teeth.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/compare/volumes.h"

namespace toothprep {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

constexpr std::size_t kEnamel = 0, kDentin = 1, kPulp = 2, kOther = 3;

// A box 3 mm by 2 mm, `depth` deep, in the middle of the block's top face. It opens 1 mm above it.
Shape cavity(double depth, double wider = 0) {
  return box_shape(Vec3(-1.5 - wider, -depth, -1), Vec3(1.5 + wider, 1, 1));
}
Shape placed(const Shape& shape, const Pose& pose) {
  return [=](const Vec3& x) { return shape(pose.to_local(x)); };
}

struct Case {
  double voxel;
  bool turned;
};
class ExactCavity : public ::testing::TestWithParam<Case> {};

TEST_P(ExactCavity, VolumesPerTissueAreWithinThreeTenthsOfAPercent) {
  const auto [voxel, turned] = GetParam();
  const Pose pose = turned ? odd_pose() : Pose{};
  const LayeredTooth tooth = block(voxel, pose);
  const Solid original = solid_of("original", tooth);
  // Target: 3 x 2 mm, 2.53 deep. Prepared: 3.6 mm long and 2.31 deep.
  const Solid target =
      on_lattice(solid_of("target", carved(tooth, placed(cavity(2.53), pose))), original);
  const Solid prepared =
      on_lattice(solid_of("prepared", carved(tooth, placed(cavity(2.31, 0.3), pose))), original);
  const VolumeComparison v = compare_volumes(original, prepared, &target);
  const double removed = 3.6 * 2 * 2.31, required = 3 * 2 * 2.53, inside = 3 * 2 * 2.31;
  EXPECT_NEAR(v.removed.total, removed, 0.003 * removed);
  EXPECT_NEAR(v.removed.tissue[kEnamel], 3.6 * 2 * 2, 0.003 * 3.6 * 2 * 2);
  EXPECT_NEAR(v.removed.tissue[kDentin], 3.6 * 2 * 0.31, 0.003 * 3.6 * 2 * 0.31);
  EXPECT_NEAR(v.required.total, required, 0.003 * required);
  EXPECT_NEAR(v.inside.total, inside, 0.003 * inside);
  // Slivers of a few voxels: 0.3 mm thick at both ends, 0.22 mm at the floor.
  EXPECT_NEAR(v.over.total, 2 * 0.3 * 2 * 2.31, 0.003 * 2 * 0.3 * 2 * 2.31);
  EXPECT_NEAR(v.under.total, 3 * 2 * 0.22, 0.003 * 3 * 2 * 0.22);
  EXPECT_NEAR(v.over.tissue[kEnamel], 2 * 0.3 * 2 * 2, 0.003 * 2 * 0.3 * 2 * 2);
  EXPECT_NEAR(v.under.tissue[kDentin], 3 * 2 * 0.22, 0.003 * 3 * 2 * 0.22);
  EXPECT_NEAR(v.dice, 2 * inside / (removed + required), 0.003);
  EXPECT_EQ(v.added_mm3, 0);
  EXPECT_FALSE(v.pulp_exposed);
  // The balance holds by construction, not by luck.
  EXPECT_NEAR(v.removed.total, v.inside.total + v.over.total, 1e-9 * removed);
  EXPECT_NEAR(v.required.total, v.inside.total + v.under.total, 1e-9 * required);
  EXPECT_NEAR(v.removed.total, v.original.total - v.prepared.total, 1e-9 * v.original.total);
  for (const auto& [value, truth] :
       {std::pair(v.removed.total, removed), std::pair(v.over.total, 2 * 0.3 * 2 * 2.31),
        std::pair(v.under.total, 3 * 2 * 0.22)})
    EXPECT_LT(std::abs(value - truth), volume_uncertainty_mm3(truth, voxel));
  std::printf(
      "voxel %.2f %-7s removed %+.2f %%  required %+.2f %%  over %+.2f %%  under %+.2f %%\n", voxel,
      turned ? "turned" : "along", 100 * (v.removed.total / removed - 1),
      100 * (v.required.total / required - 1), 100 * (v.over.total / (2 * 0.3 * 2 * 2.31) - 1),
      100 * (v.under.total / (3 * 2 * 0.22) - 1));
}
INSTANTIATE_TEST_SUITE_P(Voxels, ExactCavity,
                         ::testing::Values(Case{0.1, false}, Case{0.1, true}, Case{0.05, false},
                                           Case{0.05, true}));

// Floors within a voxel of enamel's border, above it and below.
TEST_P(ExactCavity, TissuesOfAFloorNextToTheirBorderAreExact) {
  const auto [voxel, turned] = GetParam();
  const Pose pose = turned ? odd_pose() : Pose{};
  const LayeredTooth tooth = block(voxel, pose);
  const Solid original = solid_of("original", tooth);
  double worst = 0;
  for (const double beyond : {-0.9, -0.6, -0.35, -0.1, 0.0, 0.15, 0.4, 0.7, 0.95}) {
    const double depth = 2 + beyond * voxel, removed = 3 * 2 * depth;
    const VolumeComparison v = compare_volumes(
        original,
        on_lattice(solid_of("cut", carved(tooth, placed(cavity(depth), pose))), original));
    const double enamel = 3 * 2 * std::min(depth, 2.0), dentin = removed - enamel;
    EXPECT_NEAR(v.removed.tissue[kEnamel], enamel, 0.003 * enamel) << beyond;
    EXPECT_NEAR(v.removed.tissue[kDentin], dentin, 0.003 * removed) << beyond;
    EXPECT_NEAR(v.removed.tissue[kEnamel] + v.removed.tissue[kDentin], v.removed.total,
                1e-3 * removed);
    worst = std::max(worst, std::abs(v.removed.tissue[kEnamel] / enamel - 1));
  }
  std::printf("voxel %.2f %-7s enamel off by %.2f %% at most\n", voxel, turned ? "turned" : "along",
              100 * worst);
}

TEST(Volumes, OfEqualPreparationAndTargetNothingIsOverOrUnderPrepared) {
  const LayeredTooth tooth = molar(0.2);
  const Solid original = solid_of("original", tooth);
  const Solid cut = on_lattice(solid_of("cut", carved(tooth, class_one())), original);
  const VolumeComparison v = compare_volumes(original, cut, &cut);
  EXPECT_EQ(v.over.total, 0);
  EXPECT_EQ(v.under.total, 0);
  EXPECT_EQ(v.dice, 1);
  EXPECT_GT(v.removed.total, 10);
  EXPECT_NEAR(v.removed.total, v.removed.tissue[kEnamel] + v.removed.tissue[kDentin],
              0.01 * v.removed.total);  // their border is curved: sums of two clamped fractions
}

TEST(Volumes, TellAnOpenedPulp) {
  const LayeredTooth tooth = molar(0.2);
  const Solid original = solid_of("original", tooth);
  const auto compared = [&](double deeper) {
    return compare_volumes(original,
                           on_lattice(solid_of("cut", carved(tooth, class_one(deeper))), original));
  };
  EXPECT_FALSE(compared(0).pulp_exposed);
  EXPECT_EQ(compared(0).removed.tissue[kPulp], 0);
  const VolumeComparison deep = compared(4);
  EXPECT_TRUE(deep.pulp_exposed);
  EXPECT_GT(deep.removed.tissue[kPulp], 1);
}

TEST(Volumes, TellDamageToTheNeighbour) {
  // A tooth of dentin for x < 0 and its neighbour for x > 0.5 mm, both 4 x 4 x 4.
  const Shape own = box_shape(Vec3(-4, -2, -2), Vec3(0, 2, 2)),
              next = box_shape(Vec3(0.5, -2, -2), Vec3(4.5, 2, 2));
  const LayeredTooth both = build_tooth(
      {Vec3::Constant(0.05), 0.1}, Index3(-42, -22, -22), Index3(47, 22, 22),
      [&](const Vec3& x) {
        ToothSample s;
        s.solid = static_cast<float>(std::min(own(x), next(x)));
        s.tissue = {1, static_cast<float>(own(x)), 1};
        s.label = own(x) < 0 ? Tissue::kDentin : next(x) < 0 ? Tissue::kOther : Tissue::kAir;
        return s;
      },
      true);
  const Solid original = solid_of("original", both);
  // A slot 1 mm square along x that ends 0.3 mm deep in the neighbour.
  const Solid cut = on_lattice(
      solid_of("cut", carved(both, box_shape(Vec3(-2, -0.5, -0.5), Vec3(0.8, 0.5, 0.5)))),
      original);
  const VolumeComparison v = compare_volumes(original, cut);
  EXPECT_NEAR(v.removed.tissue[kDentin], 2.0, 0.02);
  EXPECT_NEAR(v.removed.tissue[kOther], 0.3, 0.003 + volume_uncertainty_mm3(0.3, 0.1) / 4);
}

TEST(Volumes, OfAToothOnAnotherLatticeAreTheSameButForTheRoundedEdges) {
  // The same prepared block once on the original's lattice and once resampled from a lattice of
  // another voxel size in another place. Resampling rounds edges by less than a voxel.
  const LayeredTooth tooth = block(0.1);
  const Solid original = solid_of("original", tooth);
  const Pose shifted{Vec3(0.0237, 0.0411, -0.0319), Quat::Identity()};
  const Shape shape = cavity(2.3);
  LayeredTooth elsewhere = carved(block(0.08, shifted), placed(shape, shifted));
  const Pose back{-shifted.position, Quat::Identity()};
  const Solid prepared = on_lattice(solid_of("prepared", elsewhere), original, back);
  const Solid target = on_lattice(solid_of("target", carved(tooth, shape)), original);
  const double truth = 3 * 2 * 2.3;
  const VolumeComparison v = compare_volumes(original, prepared, &target, 0.01);
  EXPECT_NEAR(v.removed.total, truth, 0.01 * truth);
  EXPECT_LT(v.over.total + v.under.total, 0.01 * truth);
  EXPECT_GT(v.dice, 0.99);
  EXPECT_LT(v.added_mm3, 0.01 * truth);
}

TEST(Volumes, AreTheSameBitsForAnyNumberOfThreads) {
  const LayeredTooth tooth = block(0.1, odd_pose());
  const Solid original = solid_of("original", tooth);
  const Solid prepared =
      on_lattice(solid_of("p", carved(tooth, placed(cavity(2.1), odd_pose()))), original);
  const auto run = [&] { return compare_volumes(original, prepared).removed.total; };
  const double many = run();
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_EQ(run(), many);
}

// ---- What is refused

TEST(RefusedTeeth, APreparationThatRemovesNothing) {
  const Solid original = solid_of("original.vdb", block(0.2));
  Solid same = on_lattice(solid_of("prepared.vdb", block(0.2)), original);
  EXPECT_THAT([&] { static_cast<void>(compare_volumes(original, same)); },
              ThrowsMessage<InputError>(
                  AllOf(HasSubstr("prepared.vdb"), HasSubstr("nothing was removed"))));
}

TEST(RefusedTeeth, ATargetThatRemovesNothing) {
  const LayeredTooth tooth = block(0.2);
  const Solid original = solid_of("original.vdb", tooth);
  const Solid cut = on_lattice(solid_of("prepared.vdb", carved(tooth, cavity(2))), original);
  const Solid same = on_lattice(solid_of("target.vdb", tooth), original);
  EXPECT_THAT(
      [&] { static_cast<void>(compare_volumes(original, cut, &same)); },
      ThrowsMessage<InputError>(AllOf(HasSubstr("target.vdb"), HasSubstr("removes nothing"))));
}

TEST(RefusedTeeth, OneThatLiesElsewhere) {
  const LayeredTooth tooth = block(0.2);
  const Solid original = solid_of("original.vdb", tooth);
  const Solid far = on_lattice(
      solid_of("prepared.vdb", carved(block(0.2, {Vec3(20, 0, 0), Quat::Identity()}), cavity(2))),
      original);
  EXPECT_THAT(
      [&] { static_cast<void>(compare_volumes(original, far)); },
      ThrowsMessage<InputError>(AllOf(HasSubstr("wholly outside"), HasSubstr("--register"))));
}

TEST(RefusedTeeth, OneThatStandsOutOfTheOriginal) {
  const LayeredTooth tooth = block(0.2);
  const Solid original = solid_of("original.vdb", tooth);
  const Pose off{Vec3(0.6, 0, 0), Quat::Identity()};
  const Solid shifted = on_lattice(
      solid_of("prepared.vdb", carved(block(0.2, off), placed(cavity(2), off))), original);
  EXPECT_THAT([&] { static_cast<void>(compare_volumes(original, shifted)); },
              ThrowsMessage<InputError>(HasSubstr("stand out of the original")));
  const Solid cut = on_lattice(solid_of("prepared.vdb", carved(tooth, cavity(2))), original);
  Solid target = shifted;
  target.file = "target.vdb";
  EXPECT_THAT([&] { static_cast<void>(compare_volumes(original, cut, &target)); },
              ThrowsMessage<InputError>(
                  AllOf(HasSubstr("target.vdb"), HasSubstr("stand out of the original"))));
}

TEST(RefusedTeeth, OneOfAnotherTooth) {
  const Solid original = solid_of("original.vdb", molar(0.2));
  // Another tooth in the same place: a block about the molar's crown.
  const Pose about{Vec3(6.1, 5.5, 17), Quat(Eigen::AngleAxisd(units::kPi / 2, Vec3::UnitX()))};
  const Solid other = on_lattice(solid_of("prepared.vdb", block(0.2, about)), original);
  EXPECT_THROW(static_cast<void>(compare_volumes(original, other)), InputError);
  // The same shape, but the layers are those of another tooth: enamel 2 mm thick and 6.
  BlockOptions thick;
  thick.voxel = 0.2;
  thick.enamel = 6;
  const Solid block_original = solid_of("original.vdb", block(0.2));
  const Solid cut =
      on_lattice(solid_of("prepared.vdb", carved(make_block(thick), cavity(2))), block_original);
  EXPECT_NEAR(cut.other_anatomy, 0.5, 0.01);
  EXPECT_THAT([&] { static_cast<void>(compare_volumes(block_original, cut)); },
              ThrowsMessage<InputError>(HasSubstr("another tooth")));
}

}  // namespace
}  // namespace toothprep
