// The molar with neighbours and gum.
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "toothprep/proof/specimen/arch.h"
#include "toothprep/step/core/errors.h"

namespace toothprep::testing {
namespace {

constexpr double kVoxel = 0.25, kGap = 0.5;

ArchOptions with(int neighbours, bool gum = false) {
  ArchOptions o;
  o.tooth.voxel = kVoxel;
  o.neighbours = neighbours;
  o.gap = kGap;
  o.gum = gum;
  return o;
}

double volume_of(const LayeredTooth& tooth) {
  double sum = 0;
  for (const double v : remaining_volumes_mm3(tooth)) sum += v;
  return sum;
}

TEST(Arch, ThePreparedToothIsTheMolarItselfAndNeighboursHaveLayersOfTheirOwn) {
  const LayeredTooth arch = make_arch(with(2));
  MolarOptions alone;
  alone.voxel = kVoxel;
  const LayeredTooth molar = make_molar(alone);
  ASSERT_EQ(bodies_text(arch.bodies->list), "36:tooth,37:neighbour,35:neighbour");
  const std::vector<double> volumes = body_volumes_mm3(arch);
  EXPECT_NEAR(volumes[0], volume_of(molar), 1e-3 * volumes[0]);
  // 37 is the molar's form at 0.97; a premolar's volume is some half of a molar's by its width and
  // length, 0.8 x 0.67, and by its single root.
  EXPECT_NEAR(volumes[1], 0.97 * 0.97 * 0.97 * volume_of(molar), 0.01 * volumes[1]);
  EXPECT_GT(volumes[2], 0.3 * volumes[0]);
  EXPECT_LT(volumes[2], 0.7 * volumes[0]);
  const PerTissue<double> whole = remaining_volumes_mm3(arch), own = remaining_volumes_mm3(molar);
  for (int k = 0; k < 3; ++k) EXPECT_GT(whole[k], 2.2 * own[k]) << kTissueNames[k];
}

// The least distance from a voxel of one body to one of another, faces taken by the level set.
TEST(Arch, TheGapIsWhatWasAskedFor) {
  const LayeredTooth arch = make_arch(with(1));
  std::vector<Vec3> surface[2];
  for (std::size_t b = 0; b < arch.solid.table_size(); ++b) {
    if (arch.solid.is_uniform(b)) continue;
    for (int v = 0; v < kBrickVoxels; ++v) {
      const float phi = arch.solid.brick(b)[v];
      const Index3 i = arch.solid.brick_origin(b) + Index3(v >> 6, v >> 3 & 7, v & 7);
      const Vec3 x = arch.lattice.to_world(i);
      if (phi <= 0 && phi > -kVoxel && x.y() > 9 && x.y() < 13 && x.z() > 12)
        surface[arch.bodies->of.brick(b)[v] - 1].push_back(x);
    }
  }
  double least = std::numeric_limits<double>::infinity();
  for (const Vec3& a : surface[0])
    for (const Vec3& b : surface[1]) least = std::min(least, (a - b).norm());
  // Centres lie up to a voxel behind each surface.
  EXPECT_GT(least, kGap - 0.05);
  EXPECT_LT(least, kGap + 2 * kVoxel);
}

TEST(Arch, AWholeArchIsSymmetricAboutItsMiddle) {
  ArchOptions o = with(13);
  o.tooth.voxel = 0.5;
  const LayeredTooth arch = make_arch(o);
  ASSERT_EQ(arch.bodies->list.size(), 14U);
  const std::vector<double> volumes = body_volumes_mm3(arch);
  const auto volume = [&](const std::string& name) {
    const auto& list = arch.bodies->list;
    const auto at =
        std::find_if(list.begin(), list.end(), [&](const Body& b) { return b.name == name; });
    return volumes[static_cast<std::size_t>(at - list.begin())];
  };
  for (const char* tooth : {"1", "2", "3", "4", "5", "6", "7"})
    EXPECT_NEAR(volume(std::string("3") + tooth), volume(std::string("4") + tooth),
                0.02 * volume(std::string("3") + tooth))
        << tooth;
}

TEST(Arch, GumIsABodyOfOther) {
  const LayeredTooth arch = make_arch(with(1, true));
  ASSERT_EQ(bodies_text(arch.bodies->list), "36:tooth,37:neighbour,gum:gum");
  EXPECT_NEAR(body_volumes_mm3(arch)[2],
              remaining_volumes_mm3(arch)[static_cast<std::size_t>(tissue_index(Tissue::kOther))],
              0.03 * body_volumes_mm3(arch)[2]);
}

TEST(Arch, WithoutNeighboursItIsTheMolar) {
  MolarOptions alone;
  alone.voxel = kVoxel;
  EXPECT_EQ(tooth_sha256(make_arch(with(0))), tooth_sha256(make_molar(alone)));
  EXPECT_FALSE(make_arch(with(0)).bodies);
  EXPECT_THROW(static_cast<void>(make_arch(with(14))), Error);
}

}  // namespace
}  // namespace toothprep::testing
