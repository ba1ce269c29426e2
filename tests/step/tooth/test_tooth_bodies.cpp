// Several bodies on one lattice.
#include <gtest/gtest.h>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/tooth/layered_tooth.h"

namespace toothprep::testing {
namespace {

// Two boxes of dentin of 2 x 2 x 2 mm, the second (of enamel) 0.3 mm beside the first along x.
constexpr double kVoxel = 0.1, kGap = 0.3;
LayeredTooth two_boxes(double gap = kGap) {
  const auto box = [](const Vec3& x, double from) {
    const Vec3 d = (x - Vec3(from + 1, 1, 1)).cwiseAbs() - Vec3::Ones();
    return d.maxCoeff() > 0 ? d.cwiseMax(0).norm() : d.maxCoeff();
  };
  LayeredTooth tooth = build_tooth(
      {Vec3::Constant(kVoxel / 2), kVoxel}, Index3::Zero(), Index3(50, 20, 20),
      [&](const Vec3& x) {
        const double first = box(x, 0), second = box(x, 2 + gap);
        ToothSample s;
        s.solid = static_cast<float>(std::min(first, second));
        s.tissue = {static_cast<float>(second), static_cast<float>(first), 1};
        s.label = first < 0 ? Tissue::kDentin : second < 0 ? Tissue::kEnamel : Tissue::kAir;
        return s;
      },
      true);
  LabelGrid of = make_body_grid(tooth.tissue, 2);
  for (std::size_t b = 0; b < of.table_size(); ++b) {
    std::uint8_t* body = of.writable_brick(b);
    for (int v = 0; v < kBrickVoxels; ++v) {
      const Vec3 x = tooth.lattice.to_world(of.brick_origin(b) + Index3(v >> 6, v >> 3 & 7, v & 7));
      body[v] = x.x() < 2 + gap / 2 ? 1 : 2;
    }
  }
  set_bodies(tooth, {{"36", BodyKind::kTooth}, {"37", BodyKind::kNeighbour}}, std::move(of));
  return tooth;
}

TEST(ToothBodies, EachVoxelOfTissueIsOfItsBodyAndAirBesideOfTheNearest) {
  const LayeredTooth tooth = two_boxes();
  const auto at = [&](double x, double y, double z) {
    const Index3 i = tooth.lattice.to_index(Vec3(x, y, z)).array().round().matrix().cast<int>();
    return static_cast<int>(tooth.bodies->of.value(i.x(), i.y(), i.z()));
  };
  EXPECT_EQ(at(1, 1, 1), 1);
  EXPECT_EQ(at(1.95, 1, 1), 1);
  EXPECT_EQ(at(2.05, 1, 1), 1) << "air, one voxel from the first";
  EXPECT_EQ(at(2.25, 1, 1), 2) << "air, one voxel from the second";
  EXPECT_EQ(at(2.35, 1, 1), 2);
  EXPECT_EQ(tooth.bodies->worked(), 0U);
}

TEST(ToothBodies, VolumesAreThoseOfTheBoxes) {
  const std::vector<double> volumes = body_volumes_mm3(two_boxes());
  ASSERT_EQ(volumes.size(), 2U);
  // Faces along the axes count exactly; only edges and corners, which a voxel bevels, don't.
  EXPECT_NEAR(volumes[0], 8, 0.05);
  EXPECT_NEAR(volumes[1], 8, 0.05);
}

TEST(ToothBodies, BricksWithOneBodyTakeNoStorage) {
  const LayeredTooth tooth = two_boxes();
  for (std::size_t b = 0; b < tooth.bodies->of.table_size(); ++b) {
    if (tooth.bodies->of.is_uniform(b)) continue;
    const Index3 first = tooth.bodies->of.brick_origin(b);
    // Only those that reach over the gap's middle hold both.
    EXPECT_LT(tooth.lattice.to_world(first).x(), 2 + kGap);
    EXPECT_GT(tooth.lattice.to_world(first + Index3::Constant(7)).x(), 2);
  }
}

TEST(ToothBodies, OthersAreSeenAsOther) {
  const LayeredTooth tooth = with_others_as_other(two_boxes());
  const PerTissue<double> volume = remaining_volumes_mm3(tooth);
  EXPECT_NEAR(volume[static_cast<std::size_t>(tissue_index(Tissue::kEnamel))], 0, 1e-6);
  EXPECT_NEAR(volume[static_cast<std::size_t>(tissue_index(Tissue::kDentin))], 8, 0.05);
  EXPECT_NEAR(volume[static_cast<std::size_t>(tissue_index(Tissue::kOther))], 8, 0.05);
  EXPECT_FALSE(tooth.bodies);
}

// Where the gap is thinner than a voxel, the kept tooth's surface lies between its last voxel, half a
// voxel inside, and the first of the other.
TEST(ToothBodies, ASurfaceBesideAnotherStaysWithinTheGap) {
  for (const double gap : {0.02, 0.05, 0.09, 0.3}) {
    const LayeredTooth tooth = with_others_as_other(two_boxes(gap));
    const PackedLevelSet& dentin = tooth.remains[1];
    const double in = dentin.value(19, 10, 10), out = dentin.value(20, 10, 10);
    ASSERT_LT(in, 0) << gap;
    ASSERT_GT(out, 0) << gap;
    const double surface = kVoxel * (19.5 + in / (in - out));
    EXPECT_GT(surface, 2 - 0.1 * kVoxel) << gap;
    EXPECT_LT(surface, 2 + std::min(gap, 0.1) + 0.1 * kVoxel) << gap;
  }
}

TEST(ToothBodies, AListIsWrittenAndReadBack) {
  const std::vector<Body> list = {
      {"36", BodyKind::kTooth}, {"37", BodyKind::kNeighbour}, {"gum", BodyKind::kGum}};
  EXPECT_EQ(bodies_text(list), "36:tooth,37:neighbour,gum:gum");
  EXPECT_EQ(parse_bodies(bodies_text(list)), list);
}

TEST(ToothBodies, OddListsAreRefused) {
  EXPECT_THROW(static_cast<void>(parse_bodies("36:tooth,37:tooth")), Error) << "two are prepared";
  EXPECT_THROW(static_cast<void>(parse_bodies("36:neighbour")), Error) << "none is";
  EXPECT_THROW(static_cast<void>(parse_bodies("36:tooth,36:gum")), Error) << "one name twice";
  EXPECT_THROW(static_cast<void>(parse_bodies("36:tooth,a b:gum")), Error) << "a blank";
  EXPECT_THROW(static_cast<void>(parse_bodies("36:crown")), Error) << "no such kind";
  EXPECT_THROW(static_cast<void>(parse_bodies("")), Error);
  LayeredTooth tooth = two_boxes();
  LabelGrid of = make_body_grid(tooth.tissue, 2);
  EXPECT_THROW(set_bodies(tooth, {{"36", BodyKind::kTooth}, {"37", BodyKind::kNeighbour}}, of),
               Error)
      << "a voxel of nobody";
}

}  // namespace
}  // namespace toothprep::testing
