// First passes through whole tissue: the work of each, and the power in the middle of the block, are the specific
// energy of what it sweeps.
#include "passes.h"

namespace toothprep::testing {
namespace {

// A flat end that leans back grinds with all of its face, and its front rim reaches beyond the bur's own print: the
// print's wall and floor meet there, within a piece.
TEST(FreshSlots, OfFlatEndsThatLeanBackTakeTheirEnergy) {
  for (const char* bur : {"cylinder:D1.2xL3.0", "inverted-cone:D1.2xL1.6xA8"})
    for (const double across : {0.0, 0.1})
      EXPECT_LT(
          errors_of({bur, 0.17, across, across > 0 ? 0.1 : 0.03, 2, {0}}, 0.05, 0.0015, 0.0015)
              .beyond,
          1)
          << bur << " leant across by " << across;
}

// Where they enter a block and leave it, its end and its top cross the same elements.
TEST(FreshSlots, OfUprightFlatEndsTakeTheirEnergyAlsoAtABlocksEnds) {
  for (const double voxel : {0.1, 0.05})
    for (const auto& [bur, depth] : {std::pair{"cylinder:D1.2xL3.0", 0.255},
                                     {"cylinder:D1.2xL3.0", 0.262},
                                     {"cylinder:D1.2xL3.0", 0.27},
                                     {"cylinder:D1.2xL4.0xR0.3", 0.56},
                                     {"inverted-cone:D1.2xL1.6xA8", 0.24}}) {
      const double allowed = voxel > 0.07 ? 0.005 : 0.002;
      EXPECT_LT(errors_of({bur, depth, 0, 0, 2, {0}}, voxel, allowed, allowed).beyond, 1)
          << bur << ", " << depth << " mm deep";
    }
}

// In the middle of the block the power is level. Many of the pieces that the top face crosses are curved
// in a shallow slot: the face divides them, and v·n and r change over them, to second order. Where the surface turns away
// from the motion, what advances and what the bur's own print leaves are cut off together.
TEST(FreshSlots, OfPartialDepthByCurvedBursTakeTheirPower) {
  for (const char* bur : {"ball:D1.2", "taper:D1.4xL4.0xA4", "cylinder:D1.2xL4.0xR0.3"}) {
    double squares = 0, worst = 0;
    int count = 0;
    for (const double along : {0.0, 0.23})
      for (const double depth : {0.15, 0.2, 0.26, 0.33, 0.45}) {
        const Passes p{bur, depth, 0.04, along, 2, {0}};
        const double error = work_per_mm_in_the_middle(p, 0.05) / (energy_of(p)[0] / kLength) - 1;
        squares += error * error;
        worst = std::max(worst, std::abs(error));
        ++count;
      }
    const double rms = std::sqrt(squares / count);
    std::printf("%-24s rms %.3f %%, worst %.3f %%\n", bur, 100 * rms, 100 * worst);
    EXPECT_LT(rms, 0.00015) << bur;
    EXPECT_LT(worst, 0.0003) << bur;
  }
}

// Where the border of the tissues crosses a piece, each of them counts with v·n in the middle of its own part: it
// differs over a piece by as much as a sixth.
TEST(FreshSlots, AcrossTheBorderOfTissuesTakeTheirPower) {
  double squares = 0, worst = 0;
  int count = 0;
  const auto add = [&](const Passes& p) {
    const double error = work_per_mm_in_the_middle(p, 0.05) / (energy_of(p)[0] / kLength) - 1;
    std::printf("%-20s %.2f mm deep, leant by %.2f: %+.3f %%\n", p.bur, p.depth, p.along,
                100 * error);
    squares += error * error;
    worst = std::max(worst, std::abs(error));
    ++count;
  };
  for (const double along : {0.0, 0.23}) {
    for (const double depth : {0.35, 0.5, 0.7}) add({"ball:D0.9", depth, 0.04, along, 0.3, {0}});
    for (const double depth : {0.5, 0.8}) add({"taper:D1.4xL4.0xA4", depth, 0.1, along, 0.4, {0}});
    for (const double depth : {0.42, 0.46})
      add({"cylinder:D1.2xL3.0", depth, 0, along - 0.17, 0.4, {0}});
  }
  const double rms = std::sqrt(squares / count);
  std::printf("rms %.3f %%, worst %.3f %%\n", 100 * rms, 100 * worst);
  EXPECT_LT(rms, 0.0002);
  EXPECT_LT(worst, 0.0004);
}

// Pieces of straight sides are as long as the band of the tissues' level sets is wide there.
TEST(FreshSlots, AcrossTheBorderOfTissuesTakeTheirPowerWithFineVoxels) {
  for (const Passes& p : {Passes{"cylinder:D1.2xL3.0", 1, 0.31, -0.17, 0.6, {0}},
                          Passes{"taper:D1.4xL4.0xA4", 0.97, -0.31, 0.24, 0.6, {0}}}) {
    const double error = work_per_mm_in_the_middle(p, 0.025) / (energy_of(p)[0] / kLength) - 1;
    std::printf("%-20s %.2f mm deep: %+.3f %%\n", p.bur, p.depth, 100 * error);
    EXPECT_NEAR(error, 0, 0.0003) << p.bur;
  }
}

}  // namespace
}  // namespace toothprep::testing
