// How a replay is measured against its exact answer: on made-up rows whose errors are known.
#include <gtest/gtest.h>

#include <cmath>

#include "toothprep/proof/figures/figure_context.h"
#include "toothprep/proof/figures/outcome.h"
#include "toothprep/proof/figures/report.h"
#include "toothprep/step/core/units.h"

namespace toothprep::figures {
namespace {

// Two tissues of forces 4 N and 1 N along y, 3000 rows each with a linear crossing of 500 rows.
Exact two_levels() {
  Exact e;
  for (int i = 0; i < 6500; ++i) {
    const double dentin = std::clamp((i - 3000) / 500.0, 0.0, 1.0);
    e.force.emplace_back(0, 4 - 3 * dentin, 0);
    e.torque.push_back(0.8 - 0.6 * dentin);
    e.area.push_back({2 * (1 - dentin), 2 * dentin, 0, 0});
  }
  return e;
}

Outcome replay_of(const Exact& exact, const std::function<Vec3(std::size_t)>& error) {
  Outcome o;
  o.parameters = preset_parameters("paper");
  for (std::size_t i = 0; i < exact.force.size(); ++i) {
    StepRecord row;
    row.grinding_force = exact.force[i] + error(i);
    row.torque = exact.torque[i];
    o.replay.rows.push_back(row);
  }
  return o;
}

TEST(FigureContext, ASpecimenIsMadeOnceForAllThatAskForTheSame) {
  const FigureOptions options;
  FigureContext context(options, 0);
  const Experiment experiment;
  figures::Run run;
  run.block.size = Vec3(2, 2, 2);
  run.block.enamel = 1;
  const LayeredTooth first = context.specimen(experiment, run, 0.2);
  const LayeredTooth again = context.specimen(experiment, run, 0.2);
  EXPECT_EQ(tooth_sha256(first), tooth_sha256(make_specimen(experiment, run, 0.2)));
  EXPECT_EQ(tooth_sha256(first), tooth_sha256(again));
  EXPECT_NE(first.solid.shared().bricks, nullptr);
  EXPECT_EQ(first.solid.shared().bricks, again.solid.shared().bricks);
  EXPECT_NE(tooth_sha256(context.specimen(experiment, run, 0.1)), tooth_sha256(first));
  run.block.enamel = 0.5;
  EXPECT_NE(tooth_sha256(context.specimen(experiment, run, 0.2)), tooth_sha256(first));
}

TEST(Plateaus, AreWhereOneTissueHasAllContactAndTheForceIsLevel) {
  const std::vector<Stretch> found = plateaus(two_levels());
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[0].tissue, Tissue::kEnamel);
  EXPECT_EQ(found[0].first, 0u);
  EXPECT_EQ(found[0].last, 3000u);
  EXPECT_EQ(found[1].tissue, Tissue::kDentin);
  EXPECT_EQ(found[1].first, 3500u);
  EXPECT_EQ(found[1].last, 6499u);
}

TEST(Plateaus, AForceThatGrowsHasNone) {
  Exact e = two_levels();
  for (std::size_t i = 0; i < e.force.size(); ++i) e.force[i] *= static_cast<double>(i);
  EXPECT_TRUE(plateaus(e).empty());
  EXPECT_EQ(fully_engaged(e).size(), 2u);
}

TEST(Deviation, OfAConstantErrorIsThatErrorOfThePlateau) {
  const Exact exact = two_levels();
  const Deviation d =
      deviation(replay_of(exact, [](std::size_t) { return Vec3(0.03, 0, 0.04); }), exact);
  EXPECT_NEAR(d.force_rms, 100 * 0.05 / 4, 1e-9);  // of 4 N
  EXPECT_NEAR(d.force_max, 100 * 0.05 / 4, 1e-9);
  EXPECT_NEAR(d.torque_rms, 0, 1e-9);
}

TEST(VoxelEffect, TellsABiasFromARipple) {
  const Exact exact = two_levels();
  const Stretch enamel = plateaus(exact)[0];
  // A bias of 1 % is voxel effect, but nothing above 2 Hz.
  const VoxelEffect bias =
      voxel_effect(replay_of(exact, [](std::size_t) { return Vec3(0, 0.04, 0); }), exact, enamel);
  EXPECT_NEAR(bias.whole, 1, 1e-9);
  EXPECT_NEAR(bias.above_2_hz, 0, 1e-6);
  // A ripple at 5 Hz (0.5 mm/s over voxels of 0.1 mm) of 1 % amplitude is 1/sqrt 2 in both.
  const VoxelEffect ripple = voxel_effect(
      replay_of(exact,
                [](std::size_t i) {
                  return Vec3(
                      0, 0.04 * std::sin(2 * units::kPi * 5 * 1e-3 * static_cast<double>(i)), 0);
                }),
      exact, enamel);
  EXPECT_NEAR(ripple.whole, 1 / std::sqrt(2.0), 0.01);
  EXPECT_NEAR(ripple.above_2_hz, 1 / std::sqrt(2.0), 0.02);
}

TEST(Claim, HoldsUpToItsToleranceAndNotBeyond) {
  EXPECT_TRUE(near("c", "", "q", "N", "x", 2.0, 2.019, 1).holds);
  EXPECT_FALSE(near("c", "", "q", "N", "x", 2.0, 2.021, 1).holds);
  EXPECT_FALSE(near("c", "", "q", "N", "x", 2.0, std::nan(""), 1).holds);
  EXPECT_TRUE(near("c", "", "q", "%", "x", 0, 0.1, 0.2, 100).holds);
  EXPECT_TRUE(bound("c", "", "q", "N", "x", 1, 0.9).holds);
  EXPECT_FALSE(bound("c", "", "q", "N", "x", 1, 1.1).holds);
  EXPECT_FALSE(bound("c", "", "q", "N", "x", 1, std::nan("")).holds);
  EXPECT_TRUE(bound("c", "", "q", "N", "x", 1, 1.1, true).holds);
}

}  // namespace
}  // namespace toothprep::figures
