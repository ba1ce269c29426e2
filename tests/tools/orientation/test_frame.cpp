#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <functional>
#include <random>

#include "toothprep/proof/specimen/molar.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/orientation/estimate_frame.h"

namespace toothprep {
namespace {

using testing::HasSubstr;
using testing::ThrowsMessage;

// What a tooth is at a place of its own frame.
using Form = std::function<Tissue(const Vec3&)>;

struct Shape {
  Form form;
  Box box;
};

// Labels only: the frame needs no level sets.
LayeredTooth labelled(const Shape& shape, const Pose& pose, double voxel) {
  Vec3 low = Vec3::Constant(1e30), high = -low;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 x = pose.to_world(Vec3(corner & 1 ? shape.box.min.x() : shape.box.max.x(),
                                      corner & 2 ? shape.box.min.y() : shape.box.max.y(),
                                      corner & 4 ? shape.box.min.z() : shape.box.max.z()));
    low = low.cwiseMin(x);
    high = high.cwiseMax(x);
  }
  const Lattice lattice{Vec3(0.03, 0.01, -0.02), voxel};
  const Index3 first = lattice.to_index(low).array().floor().matrix().cast<int>();
  const Index3 last = lattice.to_index(high).array().ceil().matrix().cast<int>();
  LayeredTooth tooth = make_empty_tooth(lattice, first, last);
  for (std::size_t b = 0; b < tooth.tissue.table_size(); ++b) {
    std::array<std::uint8_t, kBrickVoxels> labels{};
    const Index3 origin = tooth.tissue.brick_origin(b);
    for (int v = 0; v < kBrickVoxels; ++v)
      labels[v] = static_cast<std::uint8_t>(shape.form(
          pose.to_local(lattice.to_world(origin + Index3(v >> 6, (v >> 3) & 7, v & 7)))));
    tooth.tissue.set_brick(b, labels.data());
  }
  return tooth;
}

// The molar's labels, from a lattice made once.
Tissue molar_label(const Vec3& x) {
  static const LayeredTooth molar = make_molar({0.15, {}});
  const Index3 i = (molar.lattice.to_index(x).array() + 0.5).floor().matrix().cast<int>();
  return static_cast<Tissue>(molar.tissue.value(i.x(), i.y(), i.z()));
}
Shape molar() { return {molar_label, molar_bounds()}; }
// Without what is above a plane (out of the tooth).
Shape cut(const Shape& shape, const Vec3& point, const Vec3& normal) {
  return {[=](const Vec3& x) { return (x - point).dot(normal) > 0 ? Tissue::kAir : shape.form(x); },
          shape.box};
}
Shape worn(const Shape& shape, double z) { return cut(shape, Vec3(0, 0, z), Vec3::UnitZ()); }
Shape crown_of(const Shape& shape, double z, double tilt_deg = 0) {
  const double t = units::from_degree(tilt_deg);
  return cut(shape, Vec3(6.1, 5.5, z), Vec3(std::sin(t), 0, -std::cos(t)));
}

// A lower incisor's proportions: a chisel 5.5 mm wide with an enamel cap that ends at a neck which
// rises towards both neighbours, on a conical root flattened from the sides. The edge lies along x.
Tissue incisor_label(const Vec3& x) {
  const double z = x.z();
  if (z < 0 || z > 21) return Tissue::kAir;
  const double up = (z - 12) / 9;  // of the crown
  const double half_x = z < 12 ? 0.4 + 1.5 * std::sqrt(z / 12) : 1.9 + 0.85 * up;
  const double half_y = z < 12 ? 0.5 + 2.5 * std::sqrt(z / 12) : 3.0 * (1 - up) + 0.35 * up;
  const auto inside = [&](double margin) {
    const double a = half_x - margin, b = half_y - margin;
    return a > 0 && b > 0 && std::pow(x.x() / a, 2) + std::pow(x.y() / b, 2) < 1 &&
           z < 21 - 1.5 * margin;
  };
  if (!inside(0)) return Tissue::kAir;
  const double neck = 12 + 0.5 * x.x() * x.x();
  const double thickness = 0.8 * (1 - std::exp(-(z - neck) / 2));
  if (z > neck && !inside(thickness)) return Tissue::kEnamel;
  if (z < 15 && std::hypot(x.x(), x.y()) < 0.45 && z > 1.5) return Tissue::kPulp;
  return Tissue::kDentin;
}
Shape incisor() { return {incisor_label, {Vec3(-3, -3.2, 0), Vec3(3, 3.2, 21)}}; }

class Poses {
 public:
  Pose next() {
    std::normal_distribution<double> normal;
    Quat q(normal(random_), normal(random_), normal(random_), normal(random_));
    Pose pose;
    pose.orientation = q.normalized();
    pose.position = 40 * Vec3(normal(random_), normal(random_), normal(random_));
    return pose;
  }

 private:
  std::mt19937 random_{20260712};
};

double angle_deg(const Vec3& a, const Vec3& b) {
  return units::to_degree(std::acos(std::clamp(a.normalized().dot(b.normalized()), -1.0, 1.0)));
}

TEST(ToothFrame, MolarInFiftyPosesHasItsOcclusalAxisWithinThreeDegrees) {
  Poses poses;
  double largest = 0, widest = 0;
  for (int n = 0; n < 50; ++n) {
    const Pose pose = poses.next();
    const ToothFrame frame = estimate_frame(labelled(molar(), pose, 0.3));
    ASSERT_TRUE(frame.occlusal.known()) << n << ": " << frame_text(frame);
    const double off = angle_deg(frame.occlusal.direction, pose.orientation * Vec3::UnitZ());
    EXPECT_LT(off, 3) << n;
    EXPECT_LT(off, frame.occlusal.uncertainty_deg) << n;
    EXPECT_EQ(frame.occlusal.source, AxisSource::kEstimated);
    EXPECT_FALSE(frame.mesial.known());
    EXPECT_FALSE(frame.buccal.known());
    ASSERT_TRUE(frame.cervical);
    // The junction's mean height is 11.4 + <0.0375 v²> = 11.9 with v up to 5 mm; the enamel is as
    // thick as a voxel, 0.3 mm, 0.6 mm above it (1.45 (1 - exp(-0.6/2.4))).
    EXPECT_GT(pose.to_local(frame.cervical->point).z(), 11.8) << n;
    EXPECT_LT(pose.to_local(frame.cervical->point).z(), 12.6) << n;
    largest = std::max(largest, off);
    widest = std::max(widest, frame.occlusal.uncertainty_deg);
  }
  std::printf("molar in 50 poses: largest error %.2f degrees, widest uncertainty %.1f\n", largest,
              widest);
}

// Places of the specimen: tips of its kLobes (molar.cpp), the pit at (u, v) = (0, -0.2).
TEST(ToothFrame, MolarHasItsCuspsAndItsCentralFossa) {
  Poses poses;
  const std::array<Vec3, 5> tips = {Vec3(2.75, -2.55, 18.9), Vec3(2.9, 0.75, 18.75),
                                    Vec3(2.05, 3.25, 18.3), Vec3(-3.05, -2.3, 19.25),
                                    Vec3(-2.9, 2.15, 19.1)};
  for (int n = 0; n < 6; ++n) {
    const Pose pose = poses.next();
    const ToothFrame frame = estimate_frame(labelled(molar(), pose, 0.15));
    ASSERT_TRUE(frame.fossa);
    // Where in the basin its lowest place is depends on the axis; the pits lie within 0.5 mm.
    EXPECT_LT((pose.to_local(*frame.fossa) - Vec3(6.1, 5.3, 16.5)).norm(), 0.8)
        << pose.to_local(*frame.fossa).transpose();
    EXPECT_EQ(frame.form, CrownForm::kMolar) << frame.cusps.size();
    EXPECT_GE(frame.cusps.size(), 4u);  // the distal one is low, and close to its neighbour
    EXPECT_LE(frame.cusps.size(), 5u);
    for (const Vec3& cusp : frame.cusps) {
      double nearest = 1e30;
      for (const Vec3& tip : tips)
        nearest = std::min(nearest, (pose.to_local(cusp) - Vec3(6.1, 5.5, 0) - tip).norm());
      EXPECT_LT(nearest, 0.9) << pose.to_local(cusp).transpose();
    }
  }
}

// Of each: how many of so many poses must be known. What is known must be right.
void expect_right_or_not_known(const char* what, const Shape& shape, int least_known,
                               double voxel = 0.3) {
  Poses poses;
  int known = 0;
  double largest = 0;
  constexpr int kPoses = 8;
  for (int n = 0; n < kPoses; ++n) {
    const Pose pose = poses.next();
    const ToothFrame frame = estimate_frame(labelled(shape, pose, voxel));
    if (!frame.occlusal.known()) {
      EXPECT_FALSE(frame.notes.empty()) << what;
      continue;
    }
    ++known;
    const double off = angle_deg(frame.occlusal.direction, pose.orientation * Vec3::UnitZ());
    EXPECT_LT(off, frame.occlusal.uncertainty_deg) << what << ", pose " << n;
    largest = std::max(largest, off);
  }
  EXPECT_GE(known, least_known) << what;
  std::printf("%s: known in %d of %d poses, largest error %.1f degrees\n", what, known, kPoses,
              largest);
}

TEST(ToothFrame, CrownsWithoutRootsAreRightOrNotKnown) {
  expect_right_or_not_known("cut below the neck", crown_of(molar(), 10.5), 8);
  expect_right_or_not_known("cut through the enamel", crown_of(molar(), 13), 8);
  expect_right_or_not_known("cut at 20 degrees", crown_of(molar(), 13, 20), 0);
  expect_right_or_not_known("half a root", cut(molar(), Vec3(0, 0, 6), -Vec3::UnitZ()), 8);
}

TEST(ToothFrame, WornTeethAreRightOrNotKnown) {
  expect_right_or_not_known("cusps worn off", worn(molar(), 17.5), 8);
  expect_right_or_not_known("worn to a ring", worn(molar(), 15.0), 8);
  expect_right_or_not_known("a worn crown", crown_of(worn(molar(), 16), 11.0), 0);
  expect_right_or_not_known("a ring", crown_of(worn(molar(), 15), 13), 0);
  expect_right_or_not_known(
      "worn aslant", cut(molar(), Vec3(6.1, 5.5, 16.5), Vec3(0.35, 0, 0.94).normalized()), 0);
}

TEST(ToothFrame, IncisorsAreRightOrNotKnown) {
  expect_right_or_not_known("incisor", incisor(), 8, 0.2);
  expect_right_or_not_known("worn incisor", worn(incisor(), 18), 8, 0.2);
  expect_right_or_not_known("its crown", cut(incisor(), Vec3(0, 0, 11.5), -Vec3::UnitZ()), 0, 0.2);
  const ToothFrame frame = estimate_frame(labelled(incisor(), {}, 0.2));
  EXPECT_NE(frame.form, CrownForm::kMolar);
  EXPECT_NE(frame.form, CrownForm::kPremolar);
}

TEST(ToothFrame, BoneAndNeighboursThatAreLabelledOtherChangeNothing) {
  const Shape tooth = molar();
  const Shape jaw = {[&](const Vec3& x) {
                       const Tissue label = tooth.form(x);
                       if (label != Tissue::kAir) return label;
                       return x.z() < 9 || x.y() < 0.5 ? Tissue::kOther : Tissue::kAir;
                     },
                     {tooth.box.min - Vec3(3, 3, 0), tooth.box.max + Vec3(3, 3, 0)}};
  expect_right_or_not_known("in bone", jaw, 8);
}

TEST(ToothFrame, TwoTeethInOneFileHaveNoFrame) {
  const Shape one = molar();
  const Shape two = {[&](const Vec3& x) {
                       const Tissue first = one.form(x);
                       return first != Tissue::kAir ? first : one.form(x - Vec3(0, 11, 1));
                     },
                     {one.box.min, one.box.max + Vec3(0, 11, 1)}};
  const ToothFrame frame = estimate_frame(labelled(two, {}, 0.3));
  EXPECT_FALSE(frame.occlusal.known());
  ASSERT_EQ(frame.notes.size(), 1u);
  EXPECT_THAT(frame.notes[0], HasSubstr("more than one tooth"));
}

TEST(ToothFrame, WithoutEnamelOrDentinNothingIsKnown) {
  const Shape tooth = molar();
  const auto all = [&](Tissue tissue) {
    return Shape{[&tooth, tissue](const Vec3& x) {
                   return tooth.form(x) == Tissue::kAir ? Tissue::kAir : tissue;
                 },
                 tooth.box};
  };
  for (const Tissue tissue : {Tissue::kEnamel, Tissue::kDentin, Tissue::kOther}) {
    const ToothFrame frame = estimate_frame(labelled(all(tissue), {}, 0.4));
    EXPECT_FALSE(frame.occlusal.known());
    EXPECT_FALSE(frame.notes.empty());
  }
}

FrameAxis given(const Vec3& v) { return {v, 0, AxisSource::kGiven}; }

TEST(ToothFrame, ADirectionGivenWinsAndIsQuestionedWhereTheFormSaysOtherwise) {
  const LayeredTooth tooth = labelled(molar(), {}, 0.3);
  KnownAxes known;
  known.occlusal = given(Vec3(0.1, 0, 2));
  ToothFrame frame = estimate_frame(tooth, known);
  EXPECT_EQ(frame.occlusal.source, AxisSource::kGiven);
  EXPECT_LT(angle_deg(frame.occlusal.direction, Vec3(0.1, 0, 2)), 1e-9);
  EXPECT_TRUE(frame.notes.empty());
  known.occlusal = given(-Vec3::UnitZ());
  frame = estimate_frame(tooth, known);
  ASSERT_EQ(frame.notes.size(), 1u);
  EXPECT_THAT(frame.notes[0], HasSubstr("degrees off what enamel and roots say"));
}

// The specimen is a lower left first molar, 36: mesial -y, buccal +x with the crown up.
TEST(ToothFrame, TheToothsNumberMakesOneSideOfTheOther) {
  const LayeredTooth tooth = labelled(molar(), {}, 0.3);
  KnownAxes known;
  known.occlusal = given(Vec3::UnitZ());
  known.mesial = given(-Vec3::UnitY());
  EXPECT_FALSE(estimate_frame(tooth, known).buccal.known());
  known.tooth_number = 36;
  const ToothFrame frame = estimate_frame(tooth, known);
  EXPECT_LT(angle_deg(frame.buccal.direction, Vec3::UnitX()), 1e-6);
  known.tooth_number = 46;  // its mirror image
  EXPECT_LT(angle_deg(estimate_frame(tooth, known).buccal.direction, -Vec3::UnitX()), 1e-6);
  known.buccal = given(Vec3::UnitX());
  EXPECT_THAT([&] { static_cast<void>(estimate_frame(tooth, known)); },
              ThrowsMessage<Error>(HasSubstr("of tooth 46 buccal lies on the other side")));
  known.tooth_number = 19;  // the American number of this tooth
  EXPECT_THAT([&] { static_cast<void>(estimate_frame(tooth, known)); },
              ThrowsMessage<Error>(HasSubstr("no tooth number of FDI")));
  // Upper right: the patient's right is -x, the crown down; buccal is to the right.
  KnownAxes upper;
  upper.occlusal = given(-Vec3::UnitZ());
  upper.mesial = given(-Vec3::UnitY());
  upper.tooth_number = 16;
  const Pose turned{Vec3::Zero(), Quat(Eigen::AngleAxisd(units::kPi, Vec3::UnitY()))};
  const LayeredTooth down = labelled(molar(), turned, 0.3);
  EXPECT_LT(angle_deg(estimate_frame(down, upper).buccal.direction, -Vec3::UnitX()), 1e-6);
  upper.tooth_number = 13;
  EXPECT_THAT(estimate_frame(down, upper).notes,
              testing::Contains(HasSubstr("the form of a molar, which tooth 13 isn't")));
}

TEST(ToothFrame, ComesBackFromTheMetadata) {
  KnownAxes known;
  known.mesial = given(Vec3(0.1, -1, 0.2));
  known.tooth_number = 36;
  const ToothFrame frame = estimate_frame(labelled(molar(), {}, 0.3), known);
  std::map<std::string, std::string> texts = {{"source", "a test"}, {"frame_old", "gone"}};
  record_frame(frame, texts);
  EXPECT_FALSE(texts.contains("frame_old"));
  EXPECT_EQ(texts.at("source"), "a test");
  const ToothFrame back = recorded_frame(texts);
  EXPECT_LT((back.occlusal.direction - frame.occlusal.direction).norm(), 1e-12);
  EXPECT_NEAR(back.occlusal.uncertainty_deg, frame.occlusal.uncertainty_deg, 0.1);
  EXPECT_EQ(back.occlusal.source, AxisSource::kEstimated);
  EXPECT_EQ(back.mesial.source, AxisSource::kGiven);
  EXPECT_LT((back.buccal.direction - frame.buccal.direction).norm(), 1e-12);
  EXPECT_EQ(back.cusps.size(), frame.cusps.size());
  EXPECT_EQ(back.form, frame.form);
  EXPECT_EQ(back.tooth_number, 36);
  ASSERT_TRUE(back.cervical && back.occlusal_plane && back.fossa);
  EXPECT_LT((*back.fossa - *frame.fossa).norm(), 1e-5);
  std::map<std::string, std::string> again = {{"source", "a test"}};
  record_frame(back, again);
  EXPECT_EQ(again.at("frame_confidence"), texts.at("frame_confidence"));
  EXPECT_EQ(known_axes(back).mesial.source, AxisSource::kGiven);
  EXPECT_FALSE(known_axes(back).occlusal.known());  // to be estimated anew
}

TEST(ToothFrame, OfASpecimenIsRecordedAndDamagedMetadataAreRefused) {
  const ToothFrame frame = recorded_frame({{"axis_occlusal", "0 0 2"}, {"axis_mesial", "0,-1,0"}});
  EXPECT_EQ(frame.occlusal.source, AxisSource::kRecorded);
  EXPECT_EQ(frame.occlusal.uncertainty_deg, 0);
  EXPECT_EQ(frame.mesial.direction, Vec3(0, -1, 0));
  EXPECT_FALSE(frame.buccal.known());
  EXPECT_FALSE(recorded_frame({{"source", "x"}}).occlusal.known());
  const auto refused = [](const std::map<std::string, std::string>& texts, const char* why) {
    EXPECT_THAT([&] { static_cast<void>(recorded_frame(texts)); },
                ThrowsMessage<Error>(HasSubstr(why)));
  };
  refused({{"axis_occlusal", "1 2"}}, "axis_occlusal: '1 2' is not 'x y z'");
  refused({{"axis_occlusal", "nan 0 1"}}, "axis_occlusal");
  refused({{"axis_mesial", "0 0 0"}}, "the direction is zero");
  refused({{"axis_mesial", "0 0 1"}, {"axis_occlusal", "0 0 1"}}, "parallel");
  refused({{"frame_occlusal", "0 0 1"}, {"frame_confidence", "occlusal not known"}},
          "doesn't say how well frame_occlusal is known");
  // A frame in the file comes before the specimen's axes.
  EXPECT_FALSE(recorded_frame({{"axis_occlusal", "0 0 1"},
                               {"frame_confidence", "occlusal not known; mesial not known"}})
                   .occlusal.known());
}

}  // namespace
}  // namespace toothprep
