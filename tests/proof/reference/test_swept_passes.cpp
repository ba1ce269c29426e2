// What overlapping passes newly sweep, against areas that can be written down.
#include <gtest/gtest.h>

#include <cmath>

#include "toothprep/proof/reference/swept_passes.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/units.h"

namespace toothprep::reference {
namespace {

const Block kBlock{Vec3(3, 3, 4), 2};  // 2 mm of enamel, top face at y = 0

// Upright on the top face: the bur's axis is the block's y.
Quat upright() { return Quat(Eigen::AngleAxisd(-units::kPi / 2, Vec3::UnitX())); }

std::vector<PerTissue<double>> sections(const char* bur, double depth,
                                        const std::vector<double>& z) {
  std::vector<Vec3> tips;
  for (const double at : z) tips.emplace_back(0, -depth, at);
  return newly_swept_sections(make_bur(bur, ""), upright(), tips, kBlock);
}

TEST(SweptPasses, ACylinderNewlySweepsItsSideStepTimesTheDepth) {
  const auto area = sections("cylinder:D1.2xL3.0", 1.1, {0, 0.2, 0.37});
  EXPECT_NEAR(area[0][0], 1.2 * 1.1, 1e-3);
  EXPECT_NEAR(area[1][0], 0.2 * 1.1, 1e-3);
  EXPECT_NEAR(area[2][0], 0.17 * 1.1, 1e-3);
}

TEST(SweptPasses, AHalfImmersedBallNewlySweepsTheStripBetweenTwoArcs) {
  const double R = 0.6, s = 0.2;
  const auto area = sections("ball:D1.2", R, {0, s});
  // Two discs of radius R at distance s overlap by 2 R² acos(s/2R) - s/2 sqrt(4R² - s²), half of it
  // below the face.
  const double overlap = R * R * std::acos(s / (2 * R)) - s / 4 * std::sqrt(4 * R * R - s * s);
  EXPECT_NEAR(area[0][0], units::kPi * R * R / 2, 1e-3);
  EXPECT_NEAR(area[1][0], units::kPi * R * R / 2 - overlap, 1e-3);
}

TEST(SweptPasses, WhatWasSweptBeforeIsSweptNoMore) {
  const auto area = sections("cylinder:D1.2xL3.0", 1.1, {0, 0.4, 0.2});
  EXPECT_NEAR(area[2][0], 0, 1e-6);
}

TEST(SweptPasses, ThePartBelowTheBorderIsDentins) {
  const auto area = sections("cylinder:D1.2xL3.0", 2.5, {0, 0.3});
  EXPECT_NEAR(area[1][0], 0.3 * 2.0, 1e-3);
  EXPECT_NEAR(area[1][1], 0.3 * 0.5, 1e-3);
}

}  // namespace
}  // namespace toothprep::reference
