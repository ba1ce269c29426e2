// A tooth that was moved is brought back to where it was, also after a part of it was cut away.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <chrono>
#include <cstdio>

#include "cut_teeth.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/compare/registration.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::ThrowsMessage;

struct Error6 {
  double degrees, mm;  // largest displacement of a vertex
};

// What remains of `truth` after the found motion, which should undo it.
Error6 error_of(const SurfaceRegistration& found, const Pose& truth, const TriangleMesh& surface) {
  const Quat rest = found.motion.orientation * truth.orientation;
  double worst = 0;
  for (const auto& v : surface.vertices) {
    const Vec3 x = v.cast<double>();
    worst = std::max(worst, (found.motion.to_world(truth.to_world(x)) - x).norm());
  }
  return {units::to_degree(2 * std::atan2(rest.vec().norm(), std::abs(rest.w()))), worst};
}

const Solid& molar_original() {
  static const Solid solid = solid_of("molar.vdb", molar(0.1));
  return solid;
}

Solid moved_solid(Solid solid, const Pose& pose) {
  solid.surface = moved(std::move(solid.surface), pose);
  return solid;
}

const Solid& coarse_molar() {
  static const Solid solid = solid_of("molar.vdb", molar(0.2));
  return solid;
}

struct Motion {
  const char* name;
  Pose pose;
};
class MovedMolar : public ::testing::TestWithParam<Motion> {};

TEST_P(MovedMolar, WithAClassOneCavityIsFoundWithinAHundredthOfAMillimetre) {
  const Solid& original = molar_original();
  const Solid prepared = solid_of("prepared.vdb", carved(original.tooth, class_one()));
  // Not only the same vertices moved: a surface extracted on another lattice would differ by the
  // few micrometres of marching cubes; so the moved tooth is resampled on a lattice of its own.
  const Pose& truth = GetParam().pose;
  Vec3 centre = Vec3::Zero();
  for (const auto& v : prepared.surface.vertices) centre += v.cast<double>();
  centre = truth.to_world(centre / static_cast<double>(prepared.surface.vertices.size()));
  Solid box;
  const Lattice lattice{centre, 0.1};
  box.tooth = make_empty_tooth(lattice, Index3::Constant(-145), Index3::Constant(145));
  const Solid away = solid_of("prepared.vdb", on_lattice(prepared, box, truth).tooth);
  const auto start = std::chrono::steady_clock::now();
  const SurfaceRegistration found = register_surfaces(away, original);
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const Error6 error = error_of(found, truth, original.surface);
  EXPECT_LT(error.degrees, 0.05);
  EXPECT_LT(error.mm, 0.01);
  EXPECT_LT(found.residual_rms_mm, 0.01);
  EXPECT_GT(found.agreeing_share, 0.85);
  EXPECT_TRUE(found.converged);
  EXPECT_THAT(found.notes, IsEmpty());
  std::printf(
      "%-14s error %.4f deg, %.4f mm; residual rms %.4f, p95 %.4f mm; inliers %.1f %%, agree %.1f "
      "%%; %d steps, %.1f s\n",
      GetParam().name, error.degrees, error.mm, found.residual_rms_mm, found.residual_p95_mm,
      100 * found.inlier_share, 100 * found.agreeing_share, found.iterations, seconds);
}
INSTANTIATE_TEST_SUITE_P(
    Poses, MovedMolar,
    ::testing::Values(Motion{"little", pose_of(Vec3(0.3, -0.2, 0.4), Vec3(1, 2, 3), 3)},
                      Motion{"30deg_50mm", pose_of(Vec3(30, -35, 20), Vec3(1, -1, 0.5), 30)},
                      Motion{"180deg", pose_of(Vec3(5, 5, 5), Vec3(1, 0.1, 0), 180)}),
    [](const auto& test) { return test.param.name; });

TEST(Registration, OfACrownPreparationHoldsOnToTheRoot) {
  const Solid& original = coarse_molar();
  // All of the crown above z = 13 is ground off but for a cone about the long axis: more than a
  // third of the original's surface is gone.
  const Shape stump = [](const Vec3& x) {
    const double r = std::hypot(x.x() - 6.1, x.y() - 5.5);
    return std::max({r - (3.4 - 0.1 * (x.z() - 13)), x.z() - 16.2});
  };
  const Solid prepared = solid_of("crown.vdb", carved(original.tooth, [&](const Vec3& x) {
                                    return std::max(-stump(x), 13 - x.z());
                                  }));
  const Pose truth = pose_of(Vec3(4, -3, 7), Vec3(0.3, 1, 0.2), 40);
  const SurfaceRegistration found = register_surfaces(moved_solid(prepared, truth), original);
  const Error6 error = error_of(found, truth, original.surface);
  EXPECT_LT(error.degrees, 0.05);
  EXPECT_LT(error.mm, 0.01);
  std::printf("crown: agree %.1f %%, error %.4f deg %.4f mm\n", 100 * found.agreeing_share,
              error.degrees, error.mm);
}

TEST(Registration, OfABlockTellsThatItsSymmetryLeavesAChoiceAndMovesLeast) {
  const LayeredTooth tooth = block(0.2);
  const Solid original = solid_of("block.vdb", tooth);
  const Solid prepared =
      solid_of("prepared.vdb", carved(tooth, box_shape(Vec3(-1.5, -2, -1), Vec3(1.5, 1, 1))));
  const Pose truth = pose_of(Vec3(0.5, 0.2, -0.3), Vec3(1, 0.2, 0.3), 5);
  const SurfaceRegistration found = register_surfaces(moved_solid(prepared, truth), original);
  const Error6 error = error_of(found, truth, original.surface);
  EXPECT_LT(error.degrees, 0.05);
  EXPECT_LT(error.mm, 0.01);
  ASSERT_EQ(found.notes.size(), 1U);
  EXPECT_THAT(found.notes[0], HasSubstr("fit equally well"));
}

TEST(Registration, OfABodyOfRevolutionTellsThatItTurnsAboutItself) {
  const auto cone = [](const Vec3& x) {
    const double r = std::hypot(x.x(), x.y());
    return std::max((r - (3 - 0.2 * x.z())) / std::hypot(1, 0.2), std::abs(x.z()) - 4);
  };
  const LayeredTooth tooth = build_tooth(
      {Vec3::Constant(0.1), 0.2}, Index3::Constant(-25), Index3::Constant(25),
      [&](const Vec3& x) {
        ToothSample s;
        s.solid = static_cast<float>(cone(x));
        s.tissue = {1, s.solid, 1};
        s.label = s.solid < 0 ? Tissue::kDentin : Tissue::kAir;
        return s;
      },
      true);
  const Solid solid = solid_of("cone.vdb", tooth);
  const SurfaceRegistration found =
      register_surfaces(moved_solid(solid, pose_of(Vec3(1, 2, 3), Vec3(1, 1, 0), 10)), solid);
  EXPECT_LT(found.residual_rms_mm, 0.01);
  EXPECT_FALSE(found.notes.empty());
}

TEST(Registration, RefusesAnotherTooth) {
  const Solid& original = coarse_molar();
  const Solid other = solid_of("block.vdb", block(0.2));
  EXPECT_THAT([&] { register_surfaces(other, original); },
              ThrowsMessage<InputError>(HasSubstr("the teeth don't match: only")));
  // A molar 3 % larger is recognised, though it fits within 0.2 mm over more than half of it.
  Solid larger = original;
  for (auto& v : larger.surface.vertices) v *= 1.03F;
  const SurfaceRegistration loose = register_surfaces(larger, original);
  EXPECT_GT(loose.residual_p95_mm, 0.1);
  ASSERT_FALSE(loose.notes.empty());
  EXPECT_THAT(loose.notes[0], HasSubstr("the fit is loose"));
  // A molar half as wide again across: more like the original, but not it.
  Solid wide = original;
  wide.file = "wide.vdb";
  for (auto& v : wide.surface.vertices) v.x() *= 1.5F;
  EXPECT_THAT([&] { register_surfaces(wide, original); },
              ThrowsMessage<InputError>(HasSubstr("wide.vdb")));
}

TEST(Registration, IsTheSameBitsForAnyNumberOfThreads) {
  const LayeredTooth tooth = molar(0.4);
  const Solid original = solid_of("molar.vdb", tooth);
  const Solid prepared =
      moved_solid(solid_of("prepared.vdb", carved(tooth, class_one())), odd_pose());
  const Pose many = register_surfaces(prepared, original).motion;
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const Pose single = register_surfaces(prepared, original).motion;
  EXPECT_EQ(many.position, single.position);
  EXPECT_EQ(many.orientation.coeffs(), single.orientation.coeffs());
}

}  // namespace
}  // namespace toothprep
