#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/orientation/landmarks.h"

namespace toothprep {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

TEST(Landmarks, APlaneOfCuspTipsWithAPlaceBelowGivesTheOcclusalDirection) {
  const KnownAxes known = parse_landmarks(R"(
      occlusal_mm = [[0, 0, 9], [6, 0, 9], [6, 6, 9], [0, 6, 9]]
      apical_mm = [3, 3, -8]
      mesial_mm = [3, -2, 5]
      distal_mm = [3, 8, 5]
      uncertainty_mm = 0.3
      tooth_number = 36)",
                                          "marks.toml");
  EXPECT_LT((known.occlusal.direction - Vec3::UnitZ()).norm(), 1e-9);
  // The corners lie 3 mm off the middle each way; four of them halve the error.
  EXPECT_NEAR(known.occlusal.uncertainty_deg, units::to_degree(std::atan(0.3 / (3 * 2))), 1e-9);
  EXPECT_EQ(known.occlusal.source, AxisSource::kLandmarks);
  EXPECT_LT((known.mesial.direction + Vec3::UnitY()).norm(), 1e-9);
  // Both ends of 10 mm are uncertain.
  EXPECT_NEAR(known.mesial.uncertainty_deg, units::to_degree(std::atan(0.3 * std::sqrt(2.0) / 10)),
              1e-9);
  EXPECT_FALSE(known.buccal.known());
  EXPECT_EQ(known.tooth_number, 36);
}

TEST(Landmarks, TwoEndsOrAMiddleServeToo) {
  const KnownAxes known = parse_landmarks(
      "crown_mm = [0, 0, 8]\napical_mm = [0, 0, -8]\nmiddle_mm = [0, 0, 0]\nlingual_mm = [-4, 0, "
      "0]",
      "marks.toml");
  EXPECT_LT((known.occlusal.direction - Vec3::UnitZ()).norm(), 1e-9);
  EXPECT_LT((known.buccal.direction - Vec3::UnitX()).norm(), 1e-9);
}

TEST(Landmarks, APickedFossaStaysWhenTheToothIsLookedAtAgain) {
  ToothFrame frame;
  frame.fossa = parse_landmarks("fossa_mm = [1, 2, 3]", "marks.toml").fossa;
  frame.fossa_picked = true;
  std::map<std::string, std::string> texts;
  record_frame(frame, texts);
  const KnownAxes again = known_axes(recorded_frame(texts));
  ASSERT_TRUE(again.fossa);
  EXPECT_LT((*again.fossa - Vec3(1, 2, 3)).norm(), 1e-6);
  KnownAxes other;
  other.fossa = Vec3(0, 0, 1);
  EXPECT_EQ(both(other, again).fossa->z(), 1);
}

TEST(Landmarks, WhatGivesNoDirectionIsRefusedByName) {
  const auto refused = [](const std::string& toml, const char* why) {
    EXPECT_THAT([&] { static_cast<void>(parse_landmarks(toml, "marks.toml")); },
                ThrowsMessage<InputError>(HasSubstr(why)));
  };
  refused("", "gives neither a direction nor a fossa");
  refused("mesial_mm = [0, 0, 1]", "mesial_mm: needs a second place; add distal_mm or middle_mm");
  refused("mesial_mm = [0, 0, 1]\ndistal_mm = [0, 0, 0.5]", "too near");
  refused("occlusal_mm = [[0,0,0],[1,0,0],[2,0,0]]\napical_mm = [0,0,-5]", "on a line");
  refused("occlusal_mm = [[0,0,0],[3,0,0],[0,3,0]]\napical_mm = [1,1,0.1]", "which side is up");
  refused("occlusal_mm = [[0,0,0],[3,0,0],[0,3,0]]", "apical_mm: is missing");
  refused("apical_mm = [0,0,1]", "gives no direction by itself");
  refused("mesal_mm = [0,0,1]", "did you mean 'mesial_mm'?");
  refused("tooth_number = 99", "tooth number of FDI");
}

}  // namespace
}  // namespace toothprep
