// Device frame and tooth frame: a rigid map, its force, its clutch, its file.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/live/registration.h"

namespace toothprep {
namespace {

Registration turned() {
  Registration r;
  r.rotation = Quat(Eigen::AngleAxisd(0.7, Vec3(1, 2, -1).normalized()));
  r.stylus_to_bur = Quat(Eigen::AngleAxisd(-0.4, Vec3(0, 1, 1).normalized()));
  return r;
}

TEST(HandleFrame, PutsTheFirstReadingAtTheStartPlace) {
  const Vec3 device(10, -20, 30), start(1, 2, 3);
  const HandleFrame frame(turned(), device, start);
  EXPECT_LT((frame.to_world(device, Quat::Identity()).position - start).norm(), 1e-12);
  const Vec3 there = frame.to_device(start + Vec3(0.5, 0, 0));
  EXPECT_LT((frame.to_world(there, Quat::Identity()).position - start - Vec3(0.5, 0, 0)).norm(),
            1e-12);
}

TEST(HandleFrame, KeepsThePowerOfForceAndMotion) {
  const HandleFrame frame(turned(), Vec3::Zero(), Vec3::Zero());
  const Vec3 force(1, -2, 0.5), way(0.1, 0.2, -0.3);  // force in W, motion in D
  const Vec3 moved = frame.to_world(way, Quat::Identity()).position -
                     frame.to_world(Vec3::Zero(), Quat::Identity()).position;
  EXPECT_NEAR(force.dot(moved), frame.force_to_device(force).dot(way), 1e-12);
}

TEST(HandleFrame, HeldHandleStaysAndGoesOnFromThere) {
  HandleFrame frame(turned(), Vec3::Zero(), Vec3::Zero());
  const Vec3 a(1, 0, 0), b(5, 6, 7);
  const Vec3 at = frame.to_world(a, Quat::Identity()).position;
  frame.hold(a, Quat::Identity());
  EXPECT_EQ(frame.to_world(b, Quat::Identity()).position, at);
  frame.hold(b, Quat::Identity());  // still held since a
  frame.release(b, Quat::Identity());
  EXPECT_LT((frame.to_world(b, Quat::Identity()).position - at).norm(), 1e-12);
}

TEST(HandleFrame, TurningTheStylusWhileItIsHeldTurnsNothingThenNorLater) {
  HandleFrame frame(turned(), Vec3::Zero(), Vec3::Zero());
  const Quat a(Eigen::AngleAxisd(0.2, Vec3::UnitX())), b(Eigen::AngleAxisd(1.1, Vec3::UnitY()));
  const Quat at = frame.to_world(Vec3::Zero(), a).orientation;
  frame.hold(Vec3::Zero(), a);
  EXPECT_EQ(frame.to_world(Vec3::Zero(), b).orientation.coeffs(), at.coeffs());
  frame.release(Vec3::Zero(), b);
  EXPECT_LT(frame.to_world(Vec3::Zero(), b).orientation.angularDistance(at), 1e-7);
  // From there on by as much as the stylus turns.
  const Quat more = b * Quat(Eigen::AngleAxisd(0.3, Vec3::UnitZ()));
  EXPECT_NEAR(frame.to_world(Vec3::Zero(), more).orientation.angularDistance(at), 0.3, 1e-7);
  // A second time, too.
  const Quat then = frame.to_world(Vec3::Zero(), more).orientation;
  frame.hold(Vec3::Zero(), more);
  frame.release(Vec3::Zero(), a);
  EXPECT_LT(frame.to_world(Vec3::Zero(), a).orientation.angularDistance(then), 1e-7);
}

TEST(HandleFrame, AFixedAxisIsKeptWhateverTheStylusDoes) {
  Registration r = turned();
  r.fixed_orientation = orientation_of_axis(Vec3(0, 1, 0));
  const HandleFrame frame(r, Vec3::Zero(), Vec3::Zero());
  const Pose pose = frame.to_world(Vec3::Zero(), Quat(Eigen::AngleAxisd(1.0, Vec3::UnitX())));
  EXPECT_LT((pose.orientation * Vec3::UnitZ() - Vec3::UnitY()).norm(), 1e-12);
}

class RegistrationFile : public testing::Test {
 protected:
  std::string write(const std::string& text) const {
    const std::string path = (std::filesystem::temp_directory_path() /
                              ("toothprep_registration_" + std::to_string(getpid()) + ".toml"))
                                 .string();
    std::ofstream(path) << text;
    return path;
  }
};

TEST_F(RegistrationFile, IsReadAndCheckedStrictly) {
  const Registration r = read_registration(write(
      "rotation_xyzw = [0, 0, 0.6, 0.8]\ntranslation_mm = [1, 2, 3]\nfixed_axis = [0, 2, 0]\n"));
  EXPECT_NEAR(r.rotation.z(), 0.6, 1e-12);
  EXPECT_EQ(*r.translation, Vec3(1, 2, 3));
  EXPECT_LT((*r.fixed_orientation * Vec3::UnitZ() - Vec3::UnitY()).norm(), 1e-12);
  EXPECT_FALSE(read_registration(write("")).translation);
  for (const char* text :
       {"rotation_xyzw = [0, 0, 1]\n", "rotation_xyzw = [0, 0, 1, 1]\n", "fixed_axis = [0, 0, 0]\n",
        "translation_mm = [nan, 0, 0]\n", "rotation = 1\n", "rotation_xyzw = \"a\"\n", "[["})
    EXPECT_THROW(static_cast<void>(read_registration(write(text))), InputError) << text;
  EXPECT_THROW(static_cast<void>(read_registration("/nowhere.toml")), InputError);
}

}  // namespace
}  // namespace toothprep
