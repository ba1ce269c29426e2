// Removal by itself: what a bur that moves leaves, against volumes that can be written down.
#include <gtest/gtest.h>
#if defined(__linux__)
#include <sys/resource.h>
#endif

#include "../session/experiment.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/grinding/removal.h"

namespace toothprep::testing {
namespace {

constexpr double kBurRadius = 0.6, kBurLength = 3;

double total_of(const PerTissue<double>& v) {
  double sum = 0;
  for (const double x : v) sum += x;
  return sum;
}
void step(Removal& removal, const Pose& pose) {
  removal.advance(pose);
  removal.carve();
}
Pose at(double x, double y, double z) { return {Vec3(x, y, z), Quat::Identity()}; }

// The block's top face is y = 0; the cylinder stands along z, wholly inside in z.
class RemovalOfACylinder : public ::testing::Test {
 protected:
  LayeredTooth tooth_ = block(0.1, 4, Vec3(6, 4, 6));
  Workpiece workpiece_{tooth_};
  Bur bur_ = paper_cylinder();
};

TEST_F(RemovalOfACylinder, ClearTakesTheBursOwnVolumeAndDoesNotCountItAsRemoved) {
  Removal removal(bur_, workpiece_, at(0, -2, -1.5));
  const double taken = total_of(removal.clear(at(0, -2, -1.5)));
  const double exact = units::kPi * kBurRadius * kBurRadius * kBurLength;
  EXPECT_NEAR(taken, exact, 0.01 * exact);
  EXPECT_EQ(total_of(removal.removed()), 0);
}

TEST_F(RemovalOfACylinder, AStraightWayTakesLengthTimesDiameterTimesWay) {
  Removal removal(bur_, workpiece_, at(0, -2, -1.5));
  removal.clear(at(0, -2, -1.5));
  double x = 0;
  for (; x < 1.0 - 1e-9; x += 0.002) step(removal, at(x, -2, -1.5));
  removal.finish(at(1.0, -2, -1.5));
  const double exact = 2 * kBurRadius * kBurLength * 1.0;
  EXPECT_NEAR(total_of(removal.removed()), exact, 0.01 * exact);
  // The same way back takes nothing more.
  for (; x > 0; x -= 0.002) step(removal, at(x, -2, -1.5));
  removal.finish(at(0, -2, -1.5));
  EXPECT_NEAR(total_of(removal.removed()), exact, 0.01 * exact);
}

TEST_F(RemovalOfACylinder, AFastWayIsSweptAndSkipsNothing) {
  Removal slow(bur_, workpiece_, at(-1, -2, -1.5));
  slow.clear(at(-1, -2, -1.5));
  step(slow, at(1, -2, -1.5));  // two millimetres at once
  slow.finish(at(1, -2, -1.5));
  const double exact = 2 * kBurRadius * kBurLength * 2.0;
  EXPECT_NEAR(total_of(slow.removed()), exact, 0.01 * exact);
}

TEST_F(RemovalOfACylinder, AFastWayRoundACornerIsNotCutShort) {
  Removal removal(bur_, workpiece_, at(-1.5, -3, -1.5));
  removal.clear(at(-1.5, -3, -1.5));
  removal.advance(at(1, -3, -1.5));  // both within a step
  removal.advance(at(1, -1, -1.5));
  removal.carve();
  removal.finish(at(1, -1, -1.5));
  // Two legs with round ends, less what both sweep at the corner and what was clear at the start.
  const double r = kBurRadius;
  const double exact = kBurLength * (2 * r * (2.5 + 2.0) + (units::kPi / 4 - 1) * r * r);
  EXPECT_NEAR(total_of(removal.removed()), exact, 0.01 * exact);
}

TEST_F(RemovalOfACylinder, AStepCarvesAShareOfALongWayAndTheRestFollows) {
  const LayeredTooth fine = block(0.05, 4, Vec3(6, 4, 6));
  Workpiece workpiece(fine);
  Removal removal(bur_, workpiece, at(-1, -2, -1.5));
  removal.clear(at(-1, -2, -1.5));
  const double exact = 2 * kBurRadius * kBurLength * 2.0;
  step(removal, at(1, -2, -1.5));
  EXPECT_LT(total_of(removal.removed()), 0.5 * exact);
  for (int i = 0; i < 50; ++i) step(removal, at(1, -2, -1.5));
  EXPECT_NEAR(total_of(removal.removed()), exact, 0.01 * exact);
}

TEST_F(RemovalOfACylinder, WhatLiesOnAPausedWayStaysThoughMoreWasLeftToCut) {
  Removal removal(bur_, workpiece_, at(-2, -2, -1.5));
  removal.clear(at(-2, -2, -1.5));
  removal.advance(at(-1.95, -2, -1.5));  // not yet due
  removal.pause(at(-1.95, -2, -1.5));
  step(removal, at(1, -2, -1.5));  // the motor is on again
  step(removal, at(1.05, -2, -1.5));
  removal.finish(at(1.05, -2, -1.5));
  // The way before the pause, and what the bur fills where it goes on.
  const double exact = kBurLength * (2 * kBurRadius * 0.05 + units::kPi * kBurRadius * kBurRadius);
  EXPECT_NEAR(total_of(removal.removed()), exact, 0.01 * exact);
}

TEST_F(RemovalOfACylinder, ABurThatOnlyStartsAgainCutsNothing) {
  Removal removal(bur_, workpiece_, at(0, -2, -1.5));
  removal.clear(at(0, -2, -1.5));
  removal.pause(at(0, -2, -1.5));
  for (int i = 0; i < 3; ++i) step(removal, at(0.5, -2, -1.5));
  removal.finish(at(0.5, -2, -1.5));
  EXPECT_EQ(total_of(removal.removed()), 0);
}

TEST_F(RemovalOfACylinder, WhatLiesOnAPausedWayStays) {
  Removal removal(bur_, workpiece_, at(0, -2, -1.5));
  removal.clear(at(0, -2, -1.5));
  removal.pause(at(0, -2, -1.5));
  removal.pause(at(0.5, -2, -1.5));
  removal.finish(at(0.5, -2, -1.5));
  EXPECT_EQ(total_of(removal.removed()), 0);
}

// What is left out, since the bur can't cut it deeper, is not missing: along a straight way the cut is
// the exact mitred distance from what was swept, drawn edges included; but for the ridges that the edge at the shank's
// end leaves between the places of the bur.
TEST(StraightSweep, TheCutIsTheMitredDistanceFromWhatWasSwept) {
  for (const char* name : {"cylinder:D1.2xL3.0", "inverted-cone:D1.2xL1.6xA8", "ball:D1.2",
                           "cone:D1.6xL4.0xT1.2xR0.3"})
    for (const auto& [way, voxel] :
         {std::pair(Vec3(0.5, 0, 0), 0.05), std::pair(Vec3(0.35, -0.3, 0.1), 0.05),
          std::pair(Vec3(0.1, 0.15, -0.4), 0.05), std::pair(Vec3(0.35, -0.3, 0.1), 0.025)}) {
      const Bur bur = make_bur(name, "");
      const LayeredTooth tooth = block(voxel, 3, Vec3(4, 3, 3));
      const Quat lean = Quat(0.9, 0.25, -0.1, 0.2).normalized();
      const Vec3 start(-0.2, -1, -0.5);
      Workpiece workpiece(tooth);
      Removal removal(bur, workpiece, {start, lean});
      removal.clear({start, lean});
      constexpr int kSteps = 200;
      for (int i = 1; i <= kSteps; ++i) step(removal, {start + i * way / kSteps, lean});
      removal.finish({start + way, lean});
      double most = 0, most_at_shank = 0;
      for (std::size_t b = 0; b < tooth.solid.table_size(); ++b) {
        if (tooth.solid.is_uniform(b) && tooth.solid.uniform_value(b) > 0) continue;
        const Index3 first = tooth.solid.brick_origin(b);
        for (int v = 0; v < kBrickVoxels; v += 61) {
          const Index3 at = first + Index3(v >> 6, v >> 3 & 7, v & 7);
          const Vec3 p = lean.conjugate() * (tooth.lattice.to_world(at) - start);
          const Vec3 along = lean.conjugate() * way;
          const auto distance = [&](double t) {
            const Vec3 q = p - t * along;
            const auto r = static_cast<float>(std::hypot(q.x(), q.y())),
                       z = static_cast<float>(q.z());
            float d;
            bur.mitred_distances(&r, &z, &d, 1);
            return double{d};
          };
          double low = 0, high = 1;  // of a convex solid it has one least value on the way
          for (int i = 0; i < 25; ++i) {
            const double a = low + (high - low) / 3, c = high - (high - low) / 3;
            (distance(a) < distance(c) ? high : low) = distance(a) < distance(c) ? c : a;
          }
          const double band = tooth.band();
          const double nearest = (low + high) / 2;
          const double exact = std::clamp(-distance(nearest), -band, band);
          const bool at_shank = (p - nearest * along).z() > bur.head_length() - 2 * band;
          double& error = at_shank ? most_at_shank : most;
          error = std::max(error,
                           std::abs(exact - double{workpiece.cut().value(at.x(), at.y(), at.z())}));
        }
      }
      // Places of the bur are c = 0.0275 mm apart. Between them its round sides leave ridges of c²/8 times the
      // curvature, which grows with the depth, down to the band's; an edge of up to c/2.
      constexpr double kApart = 0.0275, kSharpest = 0.6 - 0.15 - 0.15;
      EXPECT_LT(most, kApart * kApart / 8 / kSharpest + 5e-5) << name << ", " << way.transpose();
      EXPECT_LT(most_at_shank, kApart / 2) << name << ", " << way.transpose();
    }
}

TEST_F(RemovalOfACylinder, NothingIsDueBeforeAVoxelOfWay) {
  Removal removal(bur_, workpiece_, at(0, -2, -1.5));
  removal.clear(at(0, -2, -1.5));
  for (double x = 0; x < 0.099; x += 0.001) step(removal, at(x, -2, -1.5));
  EXPECT_EQ(total_of(removal.removed()), 0);
  for (double x = 0.1; x < 0.25; x += 0.001) step(removal, at(x, -2, -1.5));
  EXPECT_GT(total_of(removal.removed()), 0);
}

TEST_F(RemovalOfACylinder, InAirNothingIsRemovedAndNoBrickIsTouched) {
  const std::size_t bricks = workpiece_.cut().bricks_stored();
  Removal removal(bur_, workpiece_, at(0, 3, -1.5));
  removal.clear(at(0, 3, -1.5));
  for (double x = 0; x < 1; x += 0.01) step(removal, at(x, 3, -1.5));
  removal.finish(at(1, 3, -1.5));
  EXPECT_EQ(total_of(removal.removed()), 0);
  EXPECT_EQ(workpiece_.cut().bricks_stored(), bricks);
}

#if defined(__linux__)
long page_faults() {
  rusage usage{};
  getrusage(RUSAGE_THREAD, &usage);
  return usage.ru_minflt;
}

// Two bricks share a page: taken as they come, they would cost a fault for two. AddressSanitizer's own pages cost
// a fault for about six. The first slot also faults for code and data that the second finds in memory; its
// workpiece lives on, so that the second can't take what it gave back.
TEST(BricksOfACut, AreInMemoryBeforeTheFirstStepTakesThem) {
  const LayeredTooth tooth = block(0.05, 4, Vec3(6, 4, 6));
  const Bur bur = paper_cylinder();
  Workpiece first(tooth), second(tooth);
  long faults = 0;
  for (Workpiece* workpiece : {&first, &second}) {
    Removal removal(bur, *workpiece, at(0, -2, -1.5));
    const long before = page_faults();
    removal.clear(at(0, -2, -1.5));
    for (double x = 0; x < 1; x += 0.002) step(removal, at(x, -2, -1.5));
    faults = page_faults() - before;
  }
  const auto bricks = static_cast<long>(second.cut().bricks_stored());
  EXPECT_GT(bricks, 200);
  EXPECT_LT(faults, bricks / 4);
}
#endif

TEST_F(RemovalOfACylinder, TheVolumeFallsToTheTissuesOnBothSidesOfABorder) {
  // Enamel 1 mm over dentin, the axis on the border: half and half.
  const LayeredTooth layered = block(0.1, 1, Vec3(6, 4, 6));
  Workpiece workpiece(layered);
  Removal removal(bur_, workpiece, at(0, -1, -1.5));
  removal.clear(at(0, -1, -1.5));
  step(removal, at(1, -1, -1.5));
  removal.finish(at(1, -1, -1.5));
  const double half = kBurRadius * kBurLength;
  EXPECT_NEAR(removal.removed()[0], half, 0.01 * half);
  EXPECT_NEAR(removal.removed()[1], half, 0.01 * half);
}

}  // namespace
}  // namespace toothprep::testing
