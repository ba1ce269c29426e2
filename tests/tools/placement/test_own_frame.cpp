#include <gtest/gtest.h>

#include <fstream>
#include <random>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/tools/placement/own_frame.h"
#include "toothprep/tools/trajectory/path_frame.h"

namespace toothprep {
namespace {

ToothFrame known_frame(const Pose& pose) {
  ToothFrame frame;
  frame.occlusal = {pose.orientation * Vec3::UnitZ(), 0, AxisSource::kGiven};
  frame.mesial = {pose.orientation * Vec3::UnitX(), 0, AxisSource::kGiven};
  frame.fossa = pose.position;
  return frame;
}

Pose random_pose(std::mt19937& random) {
  std::uniform_real_distribution<double> any(-1, 1);
  Quat q(any(random), any(random), any(random), any(random));
  return {40 * Vec3(any(random), any(random), any(random)), q.normalized()};
}

Trajectory some_path() {
  Trajectory path;
  for (int i = 0; i < 20; ++i) {
    HandleSample s;
    s.time = 0.001 * i;
    s.pose = {Vec3(0.1 * i, -0.05 * i, 3 - 0.2 * i), orientation_of_axis(Vec3(0.02 * i, 0.1, 1))};
    path.samples.push_back(s);
    path.measured_force.push_back(Vec3(0, 0, i));
  }
  return path;
}

// The same tooth in two files: what the path does in the tooth doesn't depend on the files' poses.
TEST(OwnFrame, APathStandsInTheToothAsBeforeWhateverTheFilesPose) {
  std::mt19937 random(7);
  for (int round = 0; round < 50; ++round) {
    const Pose first = random_pose(random), second = random_pose(random);
    const Trajectory there = placed(some_path(), own_frame(known_frame(first)));
    const Pose motion = own_frame(known_frame(second)) * inverse(own_frame(known_frame(first)));
    const Trajectory here = placed(there, motion);
    for (std::size_t i = 0; i < here.samples.size(); ++i) {
      const Pose a = inverse(first) * there.samples[i].pose;
      const Pose b = inverse(second) * here.samples[i].pose;
      EXPECT_LT((a.position - b.position).norm(), 1e-6);  // 1 nm: rounding of 40 mm
      EXPECT_LT(a.orientation.angularDistance(b.orientation), 1e-7);
      EXPECT_LT((first.orientation.conjugate() * there.measured_force[i] -
                 second.orientation.conjugate() * here.measured_force[i])
                    .norm(),
                1e-9);
    }
  }
}

TEST(OwnFrame, ZIsOcclusalXIsMesialAndTheOriginIsTheFossa) {
  ToothFrame frame;
  frame.occlusal = {Vec3::UnitY(), 0, AxisSource::kGiven};
  frame.mesial = {-Vec3::UnitX(), 0, AxisSource::kGiven};
  frame.fossa = Vec3(1, 2, 3);
  const Pose pose = own_frame(frame);
  EXPECT_LT((pose.to_world({1, 0, 0}) - Vec3(0, 2, 3)).norm(), 1e-12);
  EXPECT_LT((pose.to_world({0, 0, 1}) - Vec3(1, 3, 3)).norm(), 1e-12);
  EXPECT_LT((pose.to_world({0, 1, 0}) - Vec3(1, 2, 4)).norm(), 1e-12);
}

TEST(OwnFrame, ATurnIsAboutOcclusalAndReplacesMesial) {
  ToothFrame frame;
  frame.occlusal = {Vec3::UnitZ(), 0, AxisSource::kGiven};
  frame.fossa = Vec3::Zero();
  EXPECT_THROW(own_frame(frame), Error);
  const Pose pose = own_frame(frame, {}, units::from_degree(90));
  EXPECT_LT((pose.to_world({1, 0, 0}) - Vec3(0, 1, 0)).norm(), 1e-12);  // counted from W's x
  frame.mesial = {Vec3::UnitY(), 0, AxisSource::kGiven};
  EXPECT_LT(
      (own_frame(frame, {}, units::from_degree(90)).to_world({1, 0, 0}) - Vec3(-1, 0, 0)).norm(),
      1e-12);
}

TEST(OwnFrame, WhatIsNotKnownIsAnError) {
  ToothFrame frame;
  EXPECT_THROW(own_frame(frame), Error);
  frame.occlusal = {Vec3::UnitZ(), 0, AxisSource::kGiven};
  frame.mesial = {Vec3::UnitX(), 0, AxisSource::kGiven};
  EXPECT_THROW(own_frame(frame), Error);  // no fossa
  EXPECT_NO_THROW(own_frame(frame, Vec3(1, 2, 3)));
}

TEST(FitPlaces, FindsTheMotionOfExactPlaces) {
  std::mt19937 random(3);
  const std::vector<Vec3> from = {{0, 0, 0}, {5, 0, 1}, {0, 4, 0}, {1, 1, 3}};
  const Pose truth = random_pose(random);
  std::vector<Vec3> to;
  for (const Vec3& x : from) to.push_back(truth.to_world(x));
  const FittedPlaces fit = fit_places(from, to);
  EXPECT_LT(fit.largest, 1e-6);
  EXPECT_LT((fit.pose.position - truth.position).norm(), 1e-6);
  to[3] += Vec3(0.4, 0, 0);
  EXPECT_GT(fit_places(from, to).rms, 0.05);
}

TEST(FitPlaces, RefusesTooFewAndPlacesOnALine) {
  EXPECT_THROW(fit_places({{0, 0, 0}, {1, 0, 0}}, {{0, 0, 0}, {1, 0, 0}}), Error);
  const std::vector<Vec3> line = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
  EXPECT_THROW(fit_places(line, line), Error);
}

constexpr const char* kScript =
    "frame = \"tooth\"\nstart_mm = [0, 0, 3]\n[[segment]]\nkind = \"line\"\nto_mm = [0, 0, -1]\n"
    "speed_mm_s = 4\n";

TEST(PathFrame, AScriptInTheToothsFrameIsReadOnlyByThoseWhoPlaceIt) {
  PathFrame frame = PathFrame::kFile;
  EXPECT_EQ(parse_script(kScript, "x.toml", frame).samples.size(), 1001u);  // 4 mm at 4 mm/s, 1 kHz
  EXPECT_EQ(frame, PathFrame::kTooth);
  EXPECT_THROW(parse_script(kScript, "x.toml"), InputError);
}

}  // namespace
}  // namespace toothprep
