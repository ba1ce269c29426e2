// Overlapping passes, as every real cavity is cut: the work of the torque over each pass is the
// specific energy of what the pass newly sweeps. Expected from the union of the swept outlines
// (proof/reference/swept_passes.h), checked here against closed forms first.
#include "passes.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/grinding/engine.h"

namespace toothprep::testing {
namespace {

TEST(SweptSections, OfUprightBallsAndCylindersAreTheClosedForms) {
  // A cylinder newly sweeps step x depth; a ball that is half immersed, the strip between two arcs.
  const Passes cylinder{"cylinder:D1.2xL3.0", 1.1, 0, 0, 2, {0, 0.2, 0.37}};
  const std::vector<double> c = energy_of(cylinder);
  EXPECT_NEAR(c[0], kLength * 300 * 1.2 * 1.1, 1e-3 * c[0]);
  EXPECT_NEAR(c[1], kLength * 300 * 0.2 * 1.1, 1e-3 * c[0]);
  EXPECT_NEAR(c[2], kLength * 300 * 0.17 * 1.1, 1e-3 * c[0]);
  const double R = 0.6, s = 0.2;
  const std::vector<double> b = energy_of({"ball:D1.2", 0.6, 0, 0, 2, {0, s}});
  // Two discs of radius R at distance s overlap by 2 R² acos(s/2R) - s/2 sqrt(4R² - s²), half of it
  // below the face.
  const double overlap = R * R * std::acos(s / (2 * R)) - s / 4 * std::sqrt(4 * R * R - s * s);
  EXPECT_NEAR(b[0], kLength * 300 * units::kPi * R * R / 2, 1e-3 * b[0]);
  EXPECT_NEAR(b[1], kLength * 300 * (units::kPi * R * R / 2 - overlap), 1e-3 * b[0]);
}

const std::vector<Passes>& selection() {
  static const std::vector<Passes> kCases = {
      {"ball:D1.2", 0.3, 0, 0, 2, {0, 0.2, 0.37, 0.55}},
      {"cylinder:D1.2xL3.0", 1.1, 0, 0, 2, {0, 0.2, 0.37, 0.55}},
      {"cylinder:D1.2xL3.0", 1.0, 0.31, -0.17, 0.6, {0, 0.024, 0.3, 0.9}},
      {"taper:D1.4xL4.0xT0.8", 1.2, -0.23, 0.29, 2, {0, 0.25, 0.6}},
      {"inverted-cone:D1.2xL1.6xA8", 0.8, 0.12, 0.08, 0.5, {0, 0.2, 0.5}},
      {"cone:D1.6xL4.0xT1.2xR0.3", 1.1, 0.15, 0.21, 2, {0, 0.3, 0.7}},
  };
  return kCases;
}

// Passes of a second layer, upright, meet the floors and steps of the first with the straight side and the end.
Passes layers(const char* bur, double depth, double enamel, std::vector<double> z, double deeper) {
  Passes p{bur, depth, 0, 0, enamel, std::move(z)};
  p.deeper = {0, 0, deeper, deeper};
  return p;
}

TEST(OverlappingPasses, OfALowerLayerHaveTheirEnergy) {
  const char* const rounded = "cylinder:D1.2xL4.0xR0.3";
  for (const Passes& p :
       {layers(rounded, 0.28, 0.6, {0, 0.318, 0.192, -0.09}, 0.13),
        layers(rounded, 0.21, 0.3, {0, 0.125, 0.071, 0.009}, 0.33),
        layers("cylinder:D1.2xL3.0", 0.21, 0.3, {0, 0.544, 0.139, -0.23}, 0.33),
        layers("inverted-cone:D1.2xL1.6xA8", 0.18, 0.3, {0, 0.503, -0.114, 0.366}, 0.22)}) {
    expect_right(p, errors_of(p, 0.1));
    expect_right(p, errors_of(p, 0.05, 0.003, 0.0005));
  }
}

// Chips beside a corner's arc, over which an earlier floor is met where it begins to bend: that floor was taken to go on as
// the arc does, and 13 and 10 % of the last pass were lost at 0.1 and 0.05 mm.
TEST(OverlappingPasses, OfALowerLayerHaveTheirEnergyUnderAFloorThatEndsInAnArc) {
  for (const Passes& p :
       {layers("cylinder:D1.2xL4.0xR0.3", 0.25, 0.6, {0, 0.273, -0.077, 0.04}, 0.15),
        layers("cylinder:D1.2xL4.0xR0.3", 0.52, 2, {0, -0.403, -0.384, -0.211}, 0.18)}) {
    expect_right(p, errors_of(p, 0.1));
    expect_right(p, errors_of(p, 0.05, 0.003, 0.0005));
  }
}

// Over a chip as thick as half a voxel three walls lie within two voxels: a blend of them was taken for one, and 10 % of the
// last pass were lost.
TEST(OverlappingPasses, OfALowerLayerHaveTheirEnergyWhereThreeWallsMeet) {
  const Passes p =
      layers("cylinder:D1.2xL3.0", 0.241963, 2, {0, -0.070886, 0.009599, -0.018271}, 0.301241);
  expect_right(p, errors_of(p, 0.1));
  expect_right(p, errors_of(p, 0.05, 0.003, 0.0005));
}

// A corner that leans along the feed has an ellipse's floor: 8 % of the last pass were lost beside it.
TEST(OverlappingPasses, OfALowerLayerHaveTheirEnergyWhereARoundedCornerLeans) {
  const Passes p{.bur = "cylinder:D1.2xL4.0xR0.3",
                 .depth = 0.35,
                 .across = -0.24,
                 .along = -0.07,
                 .enamel = 0.6,
                 .z = {0, 0.563, 0.539, 0.296},
                 .deeper = {0, 0, 0.17, 0.17}};
  expect_right(p, errors_of(p, 0.1));
  expect_right(p, errors_of(p, 0.05, 0.003, 0.0005));
}

TEST(OverlappingPasses, WorkIsTheEnergyOfWhatIsNewlySweptAtATenthOfAMillimetre) {
  for (const Passes& p : selection()) expect_right(p, errors_of(p, 0.1));
}

// A fifth of the speed: cuts come as near to the surface as before.
TEST(OverlappingPasses, ASlowBurFeelsWhatAFastOneDoes) {
  for (Passes p : {selection()[0], selection()[4]}) {
    p.speed = 1.6;
    expect_right(p, errors_of(p, 0.1));
  }
}

// At the feed of real preparations, where a step is shorter than the way for which a sample stands.
TEST(OverlappingPasses, ABurFedByThirdsOfAMicrometreFeelsWhatAFastOneDoes) {
  for (Passes p : {selection()[0], selection()[1], selection()[4]}) {
    p.speed = 0.3;
    p.z.resize(2);
    expect_right(p, errors_of(p, 0.1));
    expect_right(p, errors_of(p, 0.05, 0.003, 0.0008));
  }
}

TEST(OverlappingPasses, WorkIsThreeTimesCloserAtHalfOfThat) {
  for (const Passes& p : selection()) expect_right(p, errors_of(p, 0.05, 0.003, 0.0005));
}

// Cuts are due after two voxels there.
TEST(OverlappingPasses, WorkIsAsCloseAtAQuarterOfThat) {
  for (Passes p : selection()) expect_right(p, errors_of(p, 0.025, 0.003, 0.0005));
}

TEST(OverlappingPasses, SideStepsFromAFiftiethToHalfOfTheDiameterAreRight) {
  for (const char* bur : {"ball:D1.2", "cylinder:D1.2xL4.0xR0.3"})  // the second ends in a torus
    for (const double step : {0.024, 0.6})
      EXPECT_LT(errors_of({bur, 0.5, 0.1, -0.15, 0.3, {0, step}}, 0.1).beyond, 1)
          << bur << ", " << step;
}

TEST(OverlappingPasses, BackThroughItsOwnSlotAnUprightBurFeelsNothing) {
  for (const char* bur : {"ball:D1.2", "cylinder:D1.2xL3.0"}) {
    EXPECT_LT(errors_of({bur, 0.5, 0, 0, 2, {0}}, 0.1).back, 0.001) << bur;
    EXPECT_LT(errors_of({bur, 0.5, 0, 0, 2, {0}}, 0.05).back, 0.001) << bur;
  }
}

// At partial depth part of the bur's side is nearly parallel to the motion and to the wall that it cut,
// which stands out by micrometres on the lattice.
TEST(OverlappingPasses, BackThroughItsOwnShallowSlotABurWithCurvedSidesFeelsNothing) {
  for (const Passes& p : {Passes{"ball:D1.2", 0.156, -0.23, -0.06, 0.6, {0}},
                          {"ball:D0.9", 0.197, -0.20, 0.03, 2, {0, 0.17, 0.258}},
                          {"ball:D0.9", 0.886, -0.10, 0.08, 0.3, {0, 0.398, 0.851}},
                          {"cylinder:D1.2xL4.0xR0.3", 0.346, 0.06, 0.11, 0.6, {0}},
                          {"taper:D1.4xL4.0xA4", 0.202, 0.01, 0.17, 0.3, {0, 0.505}},
                          {"taper:D1.4xL4.0xA4", 0.340, 0.03, 0.05, 0.6, {0, 0.041}}})
    EXPECT_LT(errors_of(p, 0.1).back, 0.001) << p.bur << ", " << p.depth << " mm deep";
}

// Leant along its feed a flat-ended bur makes the slot's floor by its sharp edge alone, at any height between the
// lattice's planes.
TEST(OverlappingPasses, BackThroughItsOwnSlotABurThatLeansAtAnyAngleFeelsNothing) {
  for (const double voxel : {0.1, 0.05})
    for (const char* bur : {"cylinder:D1.2xL3.0", "inverted-cone:D1.2xL1.6xA8"})
      for (const double depth : {0.33, 0.8})
        for (const double along : {-0.17, 0.03, 0.08, 0.16, 0.35})
          EXPECT_LT(errors_of({bur, depth, 0.05, along, 0.5, {0}}, voxel).back, 2e-4)
              << bur << ", leant by " << along << ", " << depth << " mm deep, " << voxel;
}

// Where an earlier slot lies beside its own, the lattice around a bur's edge or rounded corner is made of both.
TEST(OverlappingPasses, BackThroughItsOwnSlotBesideAnEarlierOneABurFeelsNothing) {
  const Passes cases[] = {{"inverted-cone:D1.2xL1.6xA8", 0.521, 0.288, 0.008, 2, {0, -0.584}},
                          {"inverted-cone:D1.2xL1.6xA8", 0.304, 0.134, -0.016, 0.6, {0, 0.144}},
                          {"cylinder:D1.2xL4.0xR0.3", 0.172, 0.278, -0.146, 2, {0, -0.314, 0.266}},
                          {"cylinder:D1.2xL4.0xR0.3", 0.187, -0.094, -0.009, 2, {0, 0.162}},
                          {"ball:D0.9", 0.157, 0.271, 0.125, 0.6, {0, -0.235, -0.118}}};
  for (Passes p : cases) {
    expect_right(p, errors_of(p, 0.1));
    p.forgets = true;
    expect_right(p, errors_of(p, 0.1));
  }
}

// The last pass takes what is left over a step between two layers, in the corner of a floor and a wall.
TEST(OverlappingPasses, AChipInTheCornerOfAFloorAndAWallHasItsEnergy) {
  Passes p{"cylinder:D1.2xL3.0", 0.2, 0, 0, 0.6, {0, -0.244, 0.075, -0.091}};
  p.deeper = {0, 0, 0.13, 0.13};
  EXPECT_LT(errors_of(p, 0.05, 0.003, 0.0005).beyond, 0.9);
}

// A ridge between two earlier slots some micrometres high, which the bur took between two rows of the lattice's points.
TEST(OverlappingPasses, BackOverARidgeThatTheLatticeDoesNotShowToBeGoneABurFeelsNothing) {
  const Passes cases[] = {
      {"taper:D1.4xL4.0xA4", 0.17376, 0.00043, 0.11905, 2, {0, 0.44888, -0.05916}},
      {"ball:D0.9", 0.35671, -0.01289, -0.25405, 2, {0, -0.16547, -0.08354}},
      {"taper:D1.4xL4.0xA4", 0.18522, 0.17240, -0.22899, 2, {0, -0.12778, -0.08121}}};
  for (const Passes& p : cases) EXPECT_LT(errors_of(p, 0.1).back, 0.0002) << p.bur;
}

TEST(OverlappingPasses, BesideTheSlotOfALeaningFlatEndedBurWorkIsRight) {
  for (const double voxel : {0.1, 0.05})
    for (const char* bur : {"cylinder:D1.2xL3.0", "inverted-cone:D1.2xL1.6xA8"})
      for (const double along : {-0.17, 0.08, 0.35})
        EXPECT_LT(errors_of({bur, 0.43, 0.05, along, 0.5, {0, 0.2, 0.5, -0.3}}, voxel, 0.003, 0.001)
                      .beyond,
                  1)
            << bur << ", leant by " << along << ", " << voxel;
}

// Between two shallow slots a ridge remains that is lower than a piece of the bur's surface is wide: the free
// surface and the earlier slot's wall cross the same pieces, both on the same side.
TEST(OverlappingPasses, BesideTheRidgeThatRemainsBetweenShallowSlotsWhatIsLeftCounts) {
  for (const double step : {0.3, 0.5, 0.6, 0.7})
    for (const char* bur : {"ball:D1.2", "taper:D1.4xL4.0xA4"})
      EXPECT_LT(errors_of({bur, 0.156, 0, 0, 2, {0, step}}, 0.05, 0.0015, 0.0005).beyond, 1)
          << bur << " aside by " << step << " mm";
}

// A sharp edge that is drawn along its slot leaves a narrow ellipse instead of a corner between floor and wall.
TEST(OverlappingPasses, BesideAndBelowASlotOfAFlatEndThatLeansAlongItsFeedTheWorkIsExact) {
  const std::vector<Passes> cases = {
      {"cylinder:D1.2xL3.0", 0.16, -0.13, -0.17, 0.3, {0, 0.153, 0.204}},
      {"cylinder:D1.2xL3.0", 0.19, -0.07, -0.09, 0.6, {0, 0.381, -0.137}},
      {"cylinder:D1.2xL3.0", 0.16, 0.33, 0.12, 0.3, {0, -0.42, -0.137}},
      {"inverted-cone:D1.2xL1.6xA8", 0.21, 0.3, 0.11, 0.6, {0, 0.393, 0.83}},
      {"inverted-cone:D1.2xL1.6xA8", 0.21, -0.22, -0.1, 0.3, {0, 0.44, 0.508}},
      {"inverted-cone:D1.2xL1.6xA8", 0.41, -0.05, -0.07, 2, {0, 0.175, 0.458}},
  };
  for (const Passes& p : cases) {
    expect_right(p, errors_of(p, 0.1));
    expect_right(p, errors_of(p, 0.05, 0.003, 0.0005));
  }
}

// A lean of a degree leaves an ellipse of some micrometres' height, and a chip of floor as thin, which the tooth's
// surface may cut off; and where the bur leaves the tooth no cut lies ahead of it that tells of the slot.
TEST(OverlappingPasses, BesideASlotOfAFlatEndThatLeansByADegreeTheWorkIsRight) {
  const std::vector<Passes> cases = {
      {"cylinder:D1.2xL3.0", 0.16, 0.174, -0.015, 2, {0, -0.021, -0.283}},
      {"cylinder:D1.2xL3.0", 0.16, -0.139, 0.03, 2, {0, -0.306, -0.39}},
      {"inverted-cone:D1.2xL1.6xA8", 0.16, -0.114, -0.015, 2, {0, 0.269, 0.476}},
      {"inverted-cone:D1.2xL1.6xA8", 0.4, 0.079, -0.03, 2, {0, -0.043, 0.239}},
  };
  for (const Passes& p : cases) {
    expect_right(p, errors_of(p, 0.1));
    expect_right(p, errors_of(p, 0.05, 0.003, 0.0005));
    expect_right(p, errors_of(p, 0.025, 0.003, 0.0005));
  }
}

// Over an earlier slot's floor a flat end is deep in the void, but a corner of an element may reach beyond the wall beside
// that floor: the middle of the element doesn't tell.
TEST(OverlappingPasses, WhatOnlyACornerOfAFlatEndsElementReachesCounts) {
  const char* bur = "inverted-cone:D1.2xL1.6xA8";
  for (const Passes& p : {Passes{bur, 0.1682, 0.3017, 0.3482, 0.6, {0, 0.3592, 0.5522}},
                          Passes{bur, 0.4568, 0.063, 0.2719, 0.6, {0, 0.1762, -0.061}},
                          Passes{bur, 0.155, 0.3275, 0.1645, 0.6, {0, 0.2795, -0.426}}})
    expect_right(p, errors_of(p, 0.05, 0.003, 0.0005));
}

// What is known of walls that the same bur left with the same lean must not be taken for known of others.
TEST(OverlappingPasses, BesideASlotOfAnotherBurOrLeanTheWorkIsRight) {
  struct Pass {
    const char* bur;
    double across, along, depth, z;
  };
  const char *ball = "ball:D1.2", *small = "ball:D0.9", *cylinder = "cylinder:D1.2xL3.0",
             *taper = "taper:D1.4xL4.0xA4", *cone = "inverted-cone:D1.2xL1.6xA8";
  const std::vector<std::vector<Pass>> cases = {
      {{ball, 0, 0, 0.5, 0}, {cylinder, 0.05, 0.12, 0.4, 0.3}},
      {{cylinder, 0.05, 0.12, 0.4, 0}, {ball, 0, 0, 0.5, 0.3}},
      {{ball, 0, 0, 0.5, 0}, {small, 0, 0, 0.45, -0.35}},
      {{cylinder, 0.1, 0.12, 0.4, 0}, {cylinder, 0.1, -0.08, 0.45, 0.25}},
      {{cylinder, 0.1, 0.12, 0.4, 0}, {cone, -0.1, 0.12, 0.45, -0.3}},
      {{taper, 0.1, 0.2, 0.5, 0}, {taper, -0.1, 0.05, 0.5, 0.3}},
      {{cylinder, 0.1, 0.12, 0.4, 0}, {taper, 0.1, 0.12, 0.5, 0.4}},
  };
  for (const double voxel : {0.1, 0.05})
    for (const std::vector<Pass>& passes : cases) {
      const LayeredTooth tooth = block(voxel, 2, Vec3(kLength, 3, 4));
      Workpiece workpiece(tooth);
      std::vector<Bur> burs;
      for (const Pass& p : passes) burs.push_back(make_bur(p.bur, ""));
      std::vector<reference::StraightPass> straight;
      for (std::size_t i = 0; i < passes.size(); ++i) {
        const Pass& p = passes[i];
        straight.push_back({&burs[i], upright_leant(p.across, p.along), Vec3(0, -p.depth, p.z)});
      }
      const std::vector<PerTissue<double>> areas =
          reference::newly_swept_sections(straight, reference::Block{Vec3(kLength, 3, 4), 2});
      for (std::size_t i = 0; i < passes.size(); ++i) {
        HandleSample handle{0, Pose{straight[i].tip, straight[i].orientation}, kPedalButton};
        handle.pose.position.x() = -kStart;
        Session session(burs[i], workpiece, paper_without_stall(), Drive::kDirect, handle);
        for (double x = -kStart; x <= kStart; x += 8e-3) {
          handle.time += 1e-3;
          handle.pose.position.x() = x;
          session.step(handle);
        }
        const double energy = kLength * 300 * areas[i][0], slot = kLength * 300 * areas[0][0];
        std::printf("%.2f mm, %-28s %.4f (%+.2f %%)\n", voxel, passes[i].bur,
                    session.totals().torque_work / energy,
                    100 * (session.totals().torque_work - energy) / slot);
        EXPECT_NEAR(session.totals().torque_work, energy, (voxel > 0.07 ? 0.002 : 0.0006) * slot)
            << passes[i].bur << ", " << voxel;
      }
    }
}

// A ball beside its own slot by a twentieth of its diameter: the old wall is all but parallel to it, a corner of an element
// lies in the old slot by less than a micrometre, and an eighth of a piece is void.
TEST(OverlappingPasses, WhereTheOldWallIsAllButParallelToTheBurWhatLiesInTheOldSlotIsVoid) {
  const Passes p{"ball:D0.9", 0.19, 0.1621, -0.0979, 0.6, {0, 0.0512, -0.4179}};
  EXPECT_LT(errors_of(p, 0.025, 0.003, 0.0005).beyond, 1);
}

// A third pass takes the ridge that two others left between them. On the lattice it is rounded, by 0.02 of the ball's
// pass here.
TEST(OverlappingPasses, ARidgeThatTwoPassesLeftIsTakenAsHighAsItIs) {
  for (const Passes& p :
       {Passes{"ball:D1.2", 0.16, -0.26, -0.3, 0.3, {0, -0.581, -0.23}},
        Passes{"ball:D0.9", 0.93, -0.27, 0.2, 0.3, {0, -0.284, -0.251}},
        Passes{"taper:D1.4xL4.0xA4", 0.277, 0.2173, 0.0099, 0.6, {0, -0.6162, -0.4646}}})
    for (const double voxel : {0.05, 0.025})
      EXPECT_LT(errors_of(p, voxel, 0.003, 0.0005).beyond, 1) << p.bur << ", " << voxel;
}

// Of 3 to 16 µm, at 0.1 mm, which the lattice doesn't show; what lies beside it tells of it.
TEST(OverlappingPasses, ARidgeThatTheLatticeFlattensIsTakenAsHighAsItIs) {
  for (const Passes& p : {Passes{"ball:D0.9", 0.16, 0.27, 0.12, 0.6, {0, -0.235, -0.118}},
                          Passes{"ball:D0.9", 0.93, -0.27, 0.2, 0.3, {0, -0.284, -0.251}},
                          Passes{"ball:D0.9", 0.3, 0.05, -0.02, 0.6, {0, -0.403, -0.369}},
                          Passes{"taper:D1.4xL4.0xA4", 0.36, -0.07, 0.2, 0.6, {0, -0.319, -0.268}}})
    EXPECT_LT(errors_of(p, 0.1, 0.01, 0.002).beyond, 1) << p.bur << " " << p.depth;
}

// Where floor and wall of an earlier slot meet the lattice rounds the corner. A pass of a leaning flat end beside it takes
// the sliver below that floor as well, here of 7 µm in two of them.
TEST(OverlappingPasses, BelowAndBesideASharpCornerOfAnEarlierSlotWhatIsLeftCounts) {
  const char *cylinder = "cylinder:D1.2xL3.0", *cone = "inverted-cone:D1.2xL1.6xA8";
  for (const Passes& p : {Passes{cone, 0.3, 0.13, -0.02, 0.6, {0, 0.144, -0.055}},
                          Passes{cone, 0.19, 0.15, 0.01, 2, {0, 0.123, 0.376}},
                          Passes{cone, 0.3, 0.2, 0.06, 2, {0, 0.052, -0.033}},
                          Passes{cylinder, 0.18, -0.13, -0.09, 2, {0, 0.521, -0.423}}})
    EXPECT_LT(errors_of(p, 0.05, 0.003, 0.0005).beyond, 1) << p.bur << " " << p.depth;
}

// Where the floor that a pass newly takes lies below an earlier slot's, elements at the bur's edge have the
// slot's wall beside their middle and a chip of that floor at their lower end. At 0.025 mm the free
// surface crosses some near the end of the level set's band.
TEST(OverlappingPasses, AChipOfTheFloorBelowAnEarlierSlotsWallCounts) {
  const char *cylinder = "cylinder:D1.2xL3.0", *cone = "inverted-cone:D1.2xL1.6xA8";
  for (const double along : {-0.03, -0.35}) {
    const std::vector<double> z = {0, 0.2, 0.5, -0.3};
    EXPECT_LT(errors_of({cone, 0.43, 0.05, along, 2, z}, 0.05, 0.003, 0.0005).beyond, 1) << along;
    EXPECT_LT(errors_of({cylinder, 0.43, 0.05, along, 2, z}, 0.025, 0.003, 0.0005).beyond, 1)
        << along;
  }
}

// Of elements at the slot's floor dentin alone is left to cover, where the tissues meet above it.
TEST(OverlappingPasses, WhereTissuesMeetWhatIsCoveredCounts) {
  for (const double depth : {0.42, 0.44, 0.46}) {
    const Passes p = {"cylinder:D1.2xL3.0", depth, 0, -0.17, 0.5, {0, 0.2}};
    expect_right(p, errors_of(p, 0.1));
    expect_right(p, errors_of(p, 0.05, 0.003, 0.0009));
  }
}

// Layer upon layer: each pass 0.1 mm below the one before.
TEST(OverlappingPasses, LayersOfALeaningFlatEndedBurTakeTheirEnergy) {
  for (const double voxel : {0.1, 0.05})
    for (const char* name : {"cylinder:D1.2xL3.0", "inverted-cone:D1.2xL1.6xA8"})
      for (const double along : {0.0, 0.08, -0.08, 0.2}) {
        const Bur bur = make_bur(name, "");
        const LayeredTooth tooth = block(voxel, 2, Vec3(kLength, 3, 4));
        Workpiece workpiece(tooth);
        const Quat q = upright_leant(0.12, along);
        HandleSample handle{0, Pose{Vec3(-kStart, -0.43, 0), q}, kPedalButton};
        Session session(bur, workpiece, paper_without_stall(), Drive::kDirect, handle);
        std::vector<Vec3> tips;
        std::vector<double> work;
        for (const double depth : {0.43, 0.53, 0.63}) {
          handle.pose.position = Vec3(-kStart, -depth, 0);
          handle.buttons = 0;
          session.step(handle);
          handle.buttons = kPedalButton;
          const double before = session.totals().torque_work;
          for (double x = -kStart; x <= kStart; x += 8e-3) {
            handle.time += 1e-3;
            handle.pose.position.x() = x;
            session.step(handle);
          }
          work.push_back(session.totals().torque_work - before);
          tips.emplace_back(0, -depth, 0);
        }
        const std::vector<PerTissue<double>> areas =
            reference::newly_swept_sections(bur, q, tips, reference::Block{Vec3(kLength, 3, 4), 2});
        const double slot = kLength * 300 * areas[0][0];
        std::printf("%-28s leant %.2f, %.2f mm:", name, along, voxel);
        for (std::size_t i = 0; i < work.size(); ++i) {
          const double energy = kLength * 300 * areas[i][0];
          std::printf("  %.4f (%+.2f %%)", work[i] / energy, 100 * (work[i] - energy) / slot);
          EXPECT_NEAR(work[i], energy, (voxel > 0.07 ? 0.002 : 0.001) * slot)
              << name << ", leant by " << along << ", " << voxel << ", layer " << i;
        }
        std::printf("\n");
      }
}

TEST(OverlappingPasses, RestingOrTurningAboutItsOwnAxisInItsSlotABurFeelsNothing) {
  const double depth = 0.8;
  struct Case {
    const char* bur;
    double across, along, voxel;
  };
  std::vector<Case> cases;
  for (const char* bur : {"ball:D1.2", "cylinder:D1.2xL3.0", "taper:D1.4xL4.0xT0.8",
                          "inverted-cone:D1.2xL1.6xA8", "cylinder:D1.2xL4.0xR0.3"}) {
    cases.push_back({bur, 0, 0, 0.1});
    cases.push_back({bur, 0.31, -0.17, 0.1});
    cases.push_back({bur, 0.31, -0.17, 0.05});
  }
  for (const Case& c : cases) {
    const Bur bur = make_bur(c.bur, "");
    const LayeredTooth tooth = block(c.voxel, 0.5, Vec3(kLength, 3, 4));
    const Quat q = upright_leant(c.across, c.along);
    Workpiece workpiece(tooth);
    HandleSample handle{0, Pose{Vec3(-kStart, -depth, 0), q}, kPedalButton};
    Session session(bur, workpiece, paper_without_stall(), Drive::kDirect, handle);
    double cutting = 0, resting = 0, turning = 0;  // largest forces, N
    const auto step = [&](double& largest) {
      handle.time += 1e-3;
      largest = std::max(largest, session.step(handle).grinding_force.norm());
    };
    // In the middle of the slot's end, where the bur stands in what it has cut itself.
    for (int i = 1; i <= 375; ++i) {
      handle.pose.position.x() = -kStart + 8e-3 * i;
      step(cutting);
    }
    for (int i = 0; i < 20; ++i) step(resting);
    for (int i = 1; i <= 100; ++i) {  // half a turn a second, and faster
      handle.pose.orientation = q * Quat(Eigen::AngleAxisd(3e-3 * i + 1e-4 * i * i, Vec3::UnitZ()));
      step(turning);
    }
    EXPECT_GT(cutting, 1) << c.bur;
    EXPECT_EQ(resting, 0) << c.bur << ", leant by " << c.across << ", " << c.voxel;
    EXPECT_LT(turning, 0.001 * cutting) << c.bur << ", leant by " << c.across << ", " << c.voxel;
    std::printf("%-28s tilt %4.2f, %.3f mm: turning %.4f %% of %.2f N\n", c.bur, c.across, c.voxel,
                100 * turning / cutting, cutting);
  }
}

// Two passes along arcs about an upright axis, right through the block: what each newly sweeps is the
// part of a ring that lies in the block and in no ring before, counted on a grid.
struct Arcs {
  const char* bur;
  double depth;                  // mm
  std::vector<double> r;         // mm
  double speed = 8;              // mm/s
  double across = 0, along = 0;  // rad, as upright_leant in the middle of the arcs
  bool turns = false;  // the handle, with the way; or else the bur leans the same way all along
};
constexpr double kArcCentre = -2.2;  // z of the axis, mm
constexpr double kWidest = 1.4;      // mm that any of these burs reaches beside its tip's way

Pose pose_on(const Arcs& a, double r, double angle) {
  const double turn = a.turns ? angle : 0;
  const Quat leant =
      Quat(Eigen::AngleAxisd(turn, Vec3::UnitY())) * upright_leant(a.across, a.along);
  const Vec3 upright(r * std::sin(angle), -a.depth, kArcCentre + r * std::cos(angle));
  // A ball that leans has its middle where it was.
  return {upright + 0.6 * (Vec3::UnitY() - leant * Vec3::UnitZ()), leant};
}

// The head's radius at a height above its tip.
double radius_at(const Bur& bur, double z) {
  double low = 0, high = bur.max_radius() + 0.1;
  for (int i = 0; i < 40; ++i) {
    const double middle = (low + high) / 2;
    (bur.distance(middle, z) < 0 ? low : high) = middle;
  }
  return low;
}

// The least distance (mm) of a place from a bur that leans the same way all along an arc, or any that is below -`enough`.
// A step along the arc changes the distance by its length at most.
double distance_from_arc(const Arcs& a, const Bur& bur, double r, const Vec3& place,
                         double enough) {
  const double middle = std::atan2(place.x(), place.z() - kArcCentre), window = 0.7;
  const Quat turned = pose_on(a, r, 0).orientation.conjugate();
  double least = 1;
  for (double angle = middle - window; angle < middle + window && least > -enough;) {
    const Vec3 local = turned * (place - pose_on(a, r, angle).position);
    const double distance = bur.distance(std::hypot(local.x(), local.y()), local.z());
    least = std::min(least, distance);
    angle += std::max({distance - least, distance - enough, enough / 4}) / r;
  }
  return least;
}

std::vector<double> energy_of(const Arcs& a) {
  // Or else the section isn't symmetric; of what turns with the way only balls lean.
  const bool rings = a.turns || (a.across == 0 && a.along == 0);
  const double h = 0.02;  // divides the block
  const Bur bur = make_bur(a.bur, "");
  const double below = rings ? 0 : bur.max_radius();  // how far a rim may be below the tip
  std::vector<double> energy(a.r.size());
  for (double y = -h / 2; y > -a.depth - below; y -= h) {
    const double half = radius_at(bur, y + a.depth);  // of the ring's width at this height
    for (double x = h / 2 - kLength / 2; x < kLength / 2; x += h)
      for (double z = h / 2 - 2; z < 2; z += h) {
        const double r = std::hypot(x, z - kArcCentre);
        double outside = 1;  // of all rings so far: of a cell that a rim crosses, a part
        for (std::size_t i = 0; i < a.r.size(); ++i) {
          if (std::abs(r - a.r[i]) > kWidest) continue;
          const double distance = rings ? std::abs(r - a.r[i]) - half
                                        : distance_from_arc(a, bur, a.r[i], Vec3(x, y, z), h / 2);
          const double left = std::clamp(0.5 + distance / h, 0.0, 1.0);
          energy[i] += 300 * h * h * h * std::max(0.0, outside - left);
          outside = std::min(outside, left);
        }
      }
  }
  return energy;
}

std::vector<double> work_of(const Arcs& a, double voxel) {
  const Bur bur = make_bur(a.bur, "");
  const LayeredTooth tooth = block(voxel, 2, Vec3(kLength, 3, 4));
  Workpiece workpiece(tooth);
  const double end = 2.2;  // rad from the middle: clear of the block
  HandleSample handle{0, pose_on(a, a.r[0], -end), kPedalButton};
  Session session(bur, workpiece, paper_without_stall(), Drive::kDirect, handle);
  std::vector<double> work;
  for (const double r : a.r) {
    handle.pose = pose_on(a, r, -end);
    handle.buttons = 0;
    session.step(handle);
    handle.buttons = kPedalButton;
    const double before = session.totals().torque_work;
    for (double angle = -end; angle <= end; angle += a.speed * 1e-3 / r) {
      handle.time += 1e-3;
      handle.pose = pose_on(a, r, angle);
      session.step(handle);
    }
    work.push_back(session.totals().torque_work - before);
  }
  return work;
}

void expect_right_along(const Arcs& a, const std::vector<double>& energy, double voxel,
                        double of_pass, double of_slot) {
  const std::vector<double> work = work_of(a, voxel);
  std::printf("%-20s along arcs, %.2f mm, leant %.2f, %.2f:", a.bur, voxel, a.across, a.along);
  for (std::size_t i = 0; i < energy.size(); ++i) {
    std::printf("  r %.2f mm %.4f (%+.2f %%)", a.r[i], work[i] / energy[i],
                100 * (work[i] - energy[i]) / energy[0]);
    EXPECT_NEAR(work[i], energy[i], std::max(of_pass * energy[i], of_slot * energy[0]))
        << a.bur << ", r " << a.r[i] << ", " << voxel << " mm";
  }
  std::printf("\n");
}

void expect_right_along(const Arcs& a, double voxel, double of_pass, double of_slot) {
  expect_right_along(a, energy_of(a), voxel, of_pass, of_slot);
}

TEST(OverlappingPasses, AlongArcsWorkIsTheEnergyOfWhatIsNewlySwept) {
  expect_right_along({"ball:D1.2", 0.5, {2.0, 2.2, 1.85}}, 0.1, 0.01, 0.002);
  expect_right_along({"cylinder:D1.2xL3.0", 0.72, {2.0, 2.3, 1.8}}, 0.1, 0.01, 0.002);
}

// Around a curve a bur that leans the same way all along leads with a different side at each place, so that its earlier slot
// is nowhere what it is ahead. By the lattice alone sharp-edged burs had 3 to 4 % too little in chips inside of that slot,
// the taper 1 % too much. Leant by 3 degrees the flat end takes up to some micrometres of the earlier floor.
TEST(OverlappingPasses, AlongArcsAreRightForABurThatLeansTheSameWayAllAlong) {
  struct Leaning {
    const char* bur;
    double across, along;
  };
  for (const Leaning l : {Leaning{"cylinder:D1.2xL4.0", 0.3, 0.2},
                          {"taper:D1.4xL4.0xA4", 0.2, -0.35},
                          {"inverted-cone:D1.2xL2.0xA8", -0.1, 0.2},
                          {"cylinder:D1.2xL3.0", 0.026, -0.045},
                          {"cylinder:D1.2xL4.0xR0.3", 0.1, -0.15}}) {
    const Arcs arcs{l.bur, 0.5, {2.0, 2.25, 1.94}, 4, l.across, l.along};
    const std::vector<double> energy = energy_of(arcs);
    expect_right_along(arcs, energy, 0.1, 0.01, 0.002);
    expect_right_along(arcs, energy, 0.05, 0.003, 0.0005);
  }
}

// Chips of a thirtieth of the bur, on either side of an earlier arc: their wall bends away from a straight look ahead by
// as much as they are thick.
TEST(OverlappingPasses, ThinChipsAlongArcsHaveTheirEnergy) {
  for (const double voxel : {0.1, 0.05})
    for (const double aside : {0.04, -0.04, 0.08, -0.08}) {
      if (voxel < 0.07 && std::abs(aside) > 0.05) continue;
      const double of_pass = voxel > 0.07 ? 0.01 : 0.003, of_slot = voxel > 0.07 ? 0.002 : 0.0005;
      const auto expect_right = [&](const char* bur, double depth, double lean) {
        expect_right_along({bur, depth, {2.0, 2.0 + aside}, 2, lean, 0, lean != 0}, voxel, of_pass,
                           of_slot);
      };
      expect_right("ball:D1.2", 0.5, 0);
      expect_right("ball:D1.2", 0.5, 0.1);
      for (const char* bur : {"cylinder:D1.2xL3.0", "cylinder:D1.2xL4.0xR0.3", "taper:D1.4xL4.0xA4",
                              "inverted-cone:D1.2xL1.6xA8"})
        expect_right(bur, 0.72, 0);
    }
}

// A bur that stands in its slot goes aside by `aside` and back in place, four times: the work of each
// turn over the energy of what the first takes, a segment of the bur's section.
std::vector<double> work_aside_and_back(double aside, double voxel) {
  const double R = 0.6, depth = 0.6, speed = 1.6;
  const Bur bur = make_bur("cylinder:D1.2xL3.0", "");
  const LayeredTooth tooth = block(voxel, 2, Vec3(kLength, 3, 4));
  Workpiece workpiece(tooth);
  HandleSample handle{0, Pose{Vec3(-kStart, -depth, 0), upright_leant(0, 0)}, kPedalButton};
  Session session(bur, workpiece, paper_without_stall(), Drive::kDirect, handle);
  const auto go = [&](const Vec3& to, double mm_s) {
    const Vec3 from = handle.pose.position;
    const int steps = static_cast<int>(std::ceil((to - from).norm() / mm_s / 1e-3 - 1e-9));
    for (int i = 1; i <= steps; ++i) {
      handle.time += 1e-3;
      handle.pose.position = from + (to - from) * i / steps;
      session.step(handle);
    }
  };
  go(Vec3(kStart, -depth, 0), 8);
  go(Vec3(0, -depth, 0), speed);
  const double angle = std::acos(1 - aside / R);
  const double energy = 300 * depth * R * R * (angle - std::sin(angle) * std::cos(angle));
  std::vector<double> work;
  for (int turn = 0; turn < 4; ++turn) {
    const double before = session.totals().torque_work;
    go(Vec3(0, -depth, aside), speed);
    go(Vec3(0, -depth, 0), speed);
    work.push_back((session.totals().torque_work - before) / energy);
  }
  return work;
}

// A cut is due after a voxel of way: until then the second turn may meet the same tissue. What is
// left afterwards is the wall's error on the lattice, D²/8R = 2.1 um of the 40 at a tenth of a
// millimetre, where the two outermost planes of voxels do not see the segment's tip, and the
// hundredth of a voxel by which contact is ahead of the surface.
TEST(OverlappingPasses, WhatIsGroundAsideAndBackInPlaceIsGroundOnce) {
  struct Case {
    double aside, voxel, first, later;
  };
  for (const Case c :
       {Case{0.04, 0.1, 0.005, 0.1}, {0.07, 0.1, 0.005, 0.03}, {0.04, 0.05, 0.012, 0.002}}) {
    const std::vector<double> work = work_aside_and_back(c.aside, c.voxel);
    std::printf("aside by %.2f mm at %.2f mm: %.4f %.4f %.4f %.4f of the energy\n", c.aside,
                c.voxel, work[0], work[1], work[2], work[3]);
    EXPECT_NEAR(work[0], 1, c.first) << c.aside << " mm, " << c.voxel;
    EXPECT_LT(work[2], c.later) << c.aside << " mm, " << c.voxel;
    EXPECT_LT(work[3], c.later) << c.aside << " mm, " << c.voxel;
  }
}

// How early (mm) a bur meets the end of its slot to which it comes back, by the work of the torque until it is there.
double comes_early(const char* name, double voxel) {
  constexpr int kSlots = 3;  // at different places of the lattice
  const Bur bur = make_bur(name, "");
  double again = 0, fresh = 0;  // mJ; mJ per mm
  for (int slot = 0; slot < kSlots; ++slot) {
    const LayeredTooth tooth = block(voxel, 2, Vec3(kLength, 3, 4));
    Workpiece workpiece(tooth);
    const double depth = 0.5 + 0.013 * slot, end = 0.034 * slot;
    HandleSample handle{0, Pose{Vec3(-kStart, -depth, 0.029 * slot), upright_leant(0, 0.1)},
                        kPedalButton};
    Session session(bur, workpiece, paper_without_stall(), Drive::kDirect, handle);
    const auto cut_to = [&](double x, double speed) {
      const double before = session.totals().torque_work, from = handle.pose.position.x();
      const int steps = static_cast<int>(std::ceil(std::abs(x - from) / speed / 1e-3));
      for (int i = 1; i <= steps; ++i) {
        handle.time += 1e-3;
        handle.pose.position.x() = from + (x - from) * i / steps;
        session.step(handle);
      }
      return session.totals().torque_work - before;
    };
    cut_to(end - 0.3, 8);
    fresh += cut_to(end, 0.5) / 0.3;
    again += cut_to(end - 0.5, 0.5) + cut_to(end, 0.5);
  }
  return again / fresh;
}

// The lattice interpolates what a round bur left to in front of its place, 2 to 8 um at a tenth of a millimetre. Contact
// is a hundredth of a voxel ahead of the surface.
TEST(OverlappingPasses, ABurThatComesBackToTheEndOfItsSlotMeetsItThere) {
  for (const char* bur : {"ball:D1.2", "cylinder:D1.2xL4.0xR0.3", "taper:D1.4xL4.0xA4"})
    for (const double voxel : {0.1, 0.05}) {
      const double early = comes_early(bur, voxel);
      std::printf("%s at %.2f mm: %.2f um early\n", bur, voxel, 1e3 * early);
      EXPECT_GT(early, 0) << bur << ", " << voxel;
      EXPECT_LT(early, 0.02 * voxel) << bur << ", " << voxel;
    }
}

// In the middle of the block the force is level: its vector against the integral over the part of
// the bur's surface that no earlier pass has been at.
TEST(OverlappingPasses, ForceVectorsAreThoseOfTheExactIntegralOverTheEngagedSurface) {
  for (std::size_t chosen = 0; chosen < selection().size(); ++chosen) {
    const Passes& p = selection()[chosen];
    const Bur bur = make_bur(p.bur, "");
    const Parameters parameters = paper_without_stall();
    const reference::Scene scene =
        reference::make_scene(bur, {Vec3(kLength, 3, 4), p.enamel}, parameters);
    std::vector<Vec3> tips;
    for (const double z : p.z) tips.emplace_back(0, -p.depth, z);
    const std::vector<reference::Load> loads =
        reference::loads_in_swept(scene, bur, upright_leant(p.across, p.along), tips,
                                  std::vector<double>(tips.size(), p.speed));
    const std::vector<std::vector<Vec3>> forces = forces_in_the_middle(p, 0.1);
    double full = 0;
    for (std::size_t i = 0; i < p.z.size(); ++i) {
      const Vec3 exact = loads[i].force;
      full = std::max(full, exact.norm());
      double square = 0;
      for (const Vec3& f : forces[i]) square += (f - exact).squaredNorm();
      const double rms = std::sqrt(square / static_cast<double>(forces[i].size()));
      std::printf("%-28s pass %zu: exact %.4f N, RMS %.2f %% of it, %.2f %% of a full slot\n",
                  p.bur, i, exact.norm(), 100 * rms / exact.norm(), 100 * rms / full);
      // A chip as thin as a voxel's wall error: of a full slot's force.
      EXPECT_LT(rms, std::max(0.01 * exact.norm(), 0.002 * full)) << p.bur << ", pass " << i;
    }
  }
}

// With voxels of 0.05 mm, so that the elements' error shows: a ball's pass 0.2 mm beside another.
TEST(ElementSize, HalvedItMakesTheErrorOfAnOverlappingPassFall) {
  std::vector<double> errors;
  for (const double size : {0.15, 0.075, 0.0375}) {
    const Passes p{"ball:D1.2", 0.3, 0, 0, 2, {0, 0.2}, 8, size};
    const double energy = energy_of(p)[1];
    errors.push_back(std::abs(work_of(p, 0.05)[1].pass - energy) / energy);
    std::printf("elements of %.4f mm: error %.2f %%\n", size, 100 * errors.back());
  }
  EXPECT_LT(errors[1], errors[0] / 3);
  EXPECT_LT(errors[2], errors[0] / 9);
  EXPECT_LT(errors[2], 0.001);
}

TEST(ElementSize, AboveAQuarterOfTheBursRadiusIsRefusedWithTheLargestThatWouldDo) {
  Parameters p = paper_without_stall();
  const Bur ball = paper_ball();  // R = 0.6 mm
  EXPECT_EQ(element_size(ball, p), kElementSize);
  EXPECT_EQ(element_size(make_bur("ball:D0.2", ""), p), 0.1 / 8);
  p.element_size = 0.15;
  EXPECT_EQ(element_size(ball, p), 0.15);
  p.element_size = 0.16;
  try {
    element_size(ball, p);
    FAIL() << "not refused";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("engine.element_mm"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("use at most 0.150000 mm"), std::string::npos);
  }
}

}  // namespace
}  // namespace toothprep::testing
