// Contact by itself: which elements of the bur's surface are in contact, against areas that can be
// written down.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "../session/experiment.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/grinding/contact.h"
#include "toothprep/step/grinding/engine.h"

namespace toothprep::testing {
namespace {

constexpr double kRadius = 0.6, kLength = 3, kVoxel = 0.1, kReach = 0.1 * kVoxel;

double total(const PerTissue<double>& v) {
  double sum = 0;
  for (const double x : v) sum += x;
  return sum;
}

class ContactOfACylinder : public ::testing::Test {
 protected:
  // Area of the elements in contact that advance with v (mm/s, upright bur: B is W).
  PerTissue<double> area(const Vec3& tip, const Vec3& v) {
    contact_.sample(workpiece_, Pose{tip, Quat::Identity()}, v, Vec3::Zero(), kReach);
    return contact_.contact().advancing_area(v, Vec3::Zero());
  }
  LayeredTooth tooth_ = block(kVoxel, 1, Vec3(6, 4, 6));  // 1 mm enamel over dentin, top y = 0
  Workpiece workpiece_{tooth_};
  Bur bur_ = paper_cylinder();
  ContactModel contact_{bur_, kElementSize, true, paper_without_stall().tissue};
};

TEST_F(ContactOfACylinder, InAirThereIsNone) {
  EXPECT_EQ(total(area(Vec3(0, 2, -1.5), Vec3(0, -1, 0))), 0);
  EXPECT_EQ(contact_.contact().size(), 0);
}

TEST_F(ContactOfACylinder, InUncutTissueTheLeadingHalfOfTheSideIsInContact) {
  const PerTissue<double> a = area(Vec3(0, -2, -1.5), Vec3(0, -1, 0));
  const double half = units::kPi * kRadius * kLength;
  EXPECT_NEAR(total(a), half, 0.02 * half);
  EXPECT_EQ(a[0], 0);  // from y = -1.4 down there is dentin only
}

TEST_F(ContactOfACylinder, WhatLiesAboveTheFreeSurfaceIsNotInContact) {
  // Along x with the axis in the face: the lower quarter of the side.
  const double quarter = units::kPi / 2 * kRadius * kLength;
  EXPECT_NEAR(total(area(Vec3(0, 0, -1.5), Vec3(1, 0, 0))), quarter, 0.02 * quarter);
}

TEST_F(ContactOfACylinder, TheBorderOfTwoTissuesSharesTheArea) {
  // Along x with the axis in the border: a quarter of the side in each.
  const PerTissue<double> a = area(Vec3(0, -1, -1.5), Vec3(1, 0, 0));
  const double quarter = units::kPi / 2 * kRadius * kLength;
  EXPECT_NEAR(a[0], quarter, 0.02 * quarter);
  EXPECT_NEAR(a[1], quarter, 0.02 * quarter);
}

TEST_F(ContactOfACylinder, PlungingOnlyTheFlatEndAdvances) {
  const double disc = units::kPi * kRadius * kRadius;
  EXPECT_NEAR(total(area(Vec3(0, -2, -1.5), Vec3(0, 0, -1))), disc, 0.02 * disc);
}

TEST_F(ContactOfACylinder, ASampleCoversVelocitiesNearItsOwnAndNoOthers) {
  area(Vec3(0, -2, -1.5), Vec3(0, -1, 0));
  EXPECT_TRUE(contact_.covers(Vec3(0, -3, 0)));
  EXPECT_TRUE(contact_.covers(Vec3(0.04, -1, 0)));  // 2 degrees
  EXPECT_FALSE(contact_.covers(Vec3(0.1, -1, 0)));  // 6 degrees
  EXPECT_FALSE(contact_.covers(Vec3(1, -1, 0)));
  EXPECT_FALSE(contact_.covers(Vec3(0, 1, 0)));
}

// A flat end is pressed onto the face by a fiftieth of a micrometre a sample, leaning so little that it is
// met within two micrometres: felt is the segment of its disc that lies below the face. A sample that
// stands meanwhile misses at most a tenth of a piece.
TEST_F(ContactOfACylinder, AFlatEndThatIsPressedOntoAFaceSlowlyMeetsItInTime) {
  const double lean = 0.0017, disc = units::kPi * kRadius * kRadius;
  const Quat down(Eigen::AngleAxisd(-units::kPi / 2 + lean, Vec3::UnitX()));  // its tip along -y
  double worst = 0, felt = 0;
  for (int i = 0; i < 250; ++i) {
    const double height = 0.002 - 2e-5 * i;
    const double h = std::clamp(height / std::sin(lean), -kRadius, kRadius);
    const double segment =
        kRadius * kRadius * std::acos(h / kRadius) - h * std::sqrt(kRadius * kRadius - h * h);
    const Vec3 v(0, 0, -0.02);
    contact_.sample(workpiece_, Pose{Vec3(0, height, 0), down}, v, Vec3::Zero(), kReach);
    felt = total(contact_.contact().advancing_area(v, Vec3::Zero()));
    worst = std::max(worst, std::abs(felt - segment));
  }
  EXPECT_NEAR(felt, disc, 0.01 * disc);
  EXPECT_LT(worst, 0.02 * disc);
}

// A shank that is lowered into a block, drawn out, and lowered and leant again.
TEST(AreaInTissueFromStepToStep, IsThatOfEachPose) {
  const Bur bur = paper_cylinder();
  const SurfaceElements shank = bur.shank_elements(0.4);
  const LayeredTooth tooth = block(0.1, 2, Vec3(4, 3, 4));
  const Workpiece workpiece(tooth);
  AreaInTissue area(shank);
  int zero = 0, positive = 0;
  for (int i = 0; i < 2000; ++i) {
    const double t = i * 1e-3, depth = 1.2 - 1.6 * std::abs(std::sin(3 * t));
    const Quat lean(Eigen::AngleAxisd(0.3 * t - 0.2, Vec3::UnitX()));
    const Pose pose{Vec3(0.3 * t, depth, -bur.head_length()), lean};
    const double exact = area_in_tissue(shank, workpiece, pose);
    ASSERT_EQ(area.at(workpiece, pose), exact) << i;
    ++(exact > 0 ? positive : zero);
  }
  EXPECT_GT(zero, 300);
  EXPECT_GT(positive, 300);
}

// A model that was sampled all the way finds what one finds that never was: what it keeps from
// sample to sample changes nothing but the cost.
TEST(ContactKept, AlongAPathIsWhatALookFinds) {
  const LayeredTooth tooth = block(kVoxel, 1, Vec3(6, 4, 6));
  const Bur bur = paper_ball();
  const Parameters p = paper_without_stall();
  Workpiece workpiece(tooth);
  const auto place = [](int i) {
    const double s =
        i * 0.004;  // down into the face, then along it, past the border of the tissues
    return Pose{Vec3(std::max(0.0, s - 1.1), -std::min(s, 1.1), 0.001 * i), Quat::Identity()};
  };
  const auto engine = make_engine(bur, workpiece, p, place(0));
  double worst = 0, largest = 0;
  for (int i = 0; i < 500; ++i) {
    const Vec3 v = (place(i + 1).position - place(i).position) / 1e-3;
    engine->sample(place(i), v, Vec3::Zero());
    const GrindingResponse kept = engine->contact().response(v, Vec3::Zero(), 1);
    ContactModel fresh(bur, kElementSize, true, p.tissue);
    fresh.sample(workpiece, place(i), v, Vec3::Zero(), kReach);
    const GrindingResponse looked = fresh.contact().response(v, Vec3::Zero(), 1);
    largest = std::max(largest, (looked.B * v).norm());
    worst = std::max(worst, (kept.B * v - looked.B * v).norm());
    engine->advance(place(i + 1));
  }
  EXPECT_GT(largest, 0);
  EXPECT_LT(worst, 0.005 * largest);
}

}  // namespace
}  // namespace toothprep::testing
