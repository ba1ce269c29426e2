// The paper's two-layer scheme: its layers, its forces, and the errors that belong to it.
#include <gtest/gtest.h>

#include <cmath>

#include "../session/experiment.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/grinding/voxel_engine.h"

namespace toothprep::testing {
namespace {

Parameters voxel_parameters() {
  Parameters p = paper_without_stall();
  p.engine = EngineKind::kVoxel;
  return p;
}

// Feed along -y at 0.5 mm/s from above the block to `depth`, bur's tip at z.
std::vector<HandleSample> down_to(double depth, double z, double speed = 0.5) {
  return straight_path({Vec3(0, 0.7, z), Vec3(0, -depth, z)}, speed);
}

TEST(VoxelEngine, BurWithoutInteriorVoxelIsRefused) {
  const LayeredTooth tooth = block(0.1, 1, Vec3(2, 2, 2));
  Workpiece workpiece(tooth);
  // Two voxels across but nothing a voxel beneath its surface.
  const Bur thin = make_bur("ball:D0.25", "");
  EXPECT_THROW(VoxelEngine(thin, workpiece, voxel_parameters(), {}), Error);
  const Bur enough = make_bur("ball:D0.5", "");
  EXPECT_NO_THROW(VoxelEngine(enough, workpiece, voxel_parameters(), {}));
}

TEST(VoxelEngine, MeetsTheClosedFormsOnThePlateau) {
  // Weights are shared out from the true surface, so that what is left is the resolution of the
  // advancing half by voxels.
  for (const double voxel : {0.2, 0.1, 0.05}) {
    const LayeredTooth tooth = block(voxel, 5, Vec3(4, 5, 5));
    const Outcome cylinder =
        run(tooth, paper_cylinder(), voxel_parameters(), Drive::kDirect, down_to(3, -1.5));
    const Plateau c = plateau(cylinder.rows, 0.4);
    const Outcome ball =
        run(tooth, paper_ball(), voxel_parameters(), Drive::kDirect, down_to(3, -0.6));
    const Plateau b = plateau(ball.rows, 0.4);
    const double uv_n = 300 * 0.5 / 100;
    const double cylinder_feed = uv_n * 3 / (4 * 0.25),
                 ball_feed = units::kPi * uv_n * 0.6 / (8 * 0.25);
    std::printf("%.2f mm: cylinder %.4f ball %.4f of the closed form; audits %.3f %.3f\n", voxel,
                c.force.y() / cylinder_feed, b.force.y() / ball_feed,
                cylinder.energy_ratio(voxel_parameters()), ball.energy_ratio(voxel_parameters()));
    EXPECT_NEAR(c.force.y() / cylinder_feed, 1, 0.03);
    EXPECT_NEAR(b.force.y() / ball_feed, 1, 0.03);
  }
}

TEST(VoxelEngine, CavityOneVoxelTooSmallMakesTheAuditTooLarge) {
  // What is removed is the head less one voxel all around. A slot's cross-section in the feed's
  // direction shrinks from 2R L to (2R - 2D)(L - D) where the closing face is inside the block too:
  // 3.6 / (1.0 * 2.8); a ball's from pi R² to pi (R - D)². A voxelised disc isn't a disc: 10 %.
  const LayeredTooth tooth = block(0.1, 5, Vec3(4, 5, 5));
  const Outcome cylinder =
      run(tooth, paper_cylinder(), voxel_parameters(), Drive::kDirect, down_to(4, -1.5));
  EXPECT_NEAR(cylinder.energy_ratio(voxel_parameters()), 3.6 / 2.8, 0.05);
  const Outcome ball =
      run(tooth, paper_ball(), voxel_parameters(), Drive::kDirect, down_to(4, -0.6));
  EXPECT_NEAR(ball.energy_ratio(voxel_parameters()), std::pow(0.6 / 0.5, 2), 0.1);
}

TEST(VoxelEngine, ContactIsNeverLostWhateverTheDirection) {
  // The invariant inset + reach >= sqrt(3)/2 D: once engaged, the contact area stays.
  for (const Vec3& feed : {Vec3(0, -1, 0), Vec3(0.37, -1, 0.21), Vec3(-0.8, -0.6, 0.1)}) {
    const Vec3 d = feed.normalized();
    const Outcome r =
        run(block(0.1, 4, Vec3(6, 5, 6)), paper_ball(), voxel_parameters(), Drive::kDirect,
            straight_path({Vec3(0, -1, 0), Vec3(0, -1, 0) + 1.3 * d}, 0.5));
    double least = 1e300;
    for (std::size_t i = 600; i < r.rows.size(); ++i)
      least = std::min(least, r.rows[i].contact_area[0]);
    EXPECT_GT(least, 0.9 * 2 * units::kPi * 0.36) << feed.transpose();
  }
}

TEST(VoxelEngine, WhatIsRemovedIsMissingFromTheRemainingSolid) {
  const LayeredTooth tooth = block(0.1, 1, Vec3(4, 4, 4));
  const double before = volume_mm3(tooth.solid, 0.1);
  const Outcome r = run(tooth, paper_cylinder(), voxel_parameters(), Drive::kDirect,
                        straight_path({Vec3(0.02, 0.7, -1.5), Vec3(0.4, -2, -1.3)}, 1.0));
  const double removed = r.totals.removed[0] + r.totals.removed[1];
  ASSERT_GT(r.totals.removed[1], 0);
  // Whole voxels on both sides; summing floats over 64 000 voxels costs 1e-6.
  EXPECT_NEAR(volume_mm3(r.solid, 0.1), before - removed, 1e-4);
}

TEST(VoxelEngine, TrailingElementsHoldTheBurBackAndTakeTorqueOff) {
  // The cavity is narrower than the bur, so its walls reach round the widest place and touch the
  // rear half. Counted literally (v·n < 0), those elements add -(v·n)/alpha along their rearward
  // normal, which holds the bur back, and take v·n off the torque.
  Parameters p = voxel_parameters();
  const LayeredTooth tooth = block(0.1, 5, Vec3(4, 5, 5));
  const auto steady = [&](bool trailing) {
    p.trailing_elements = trailing;
    return plateau(run(tooth, paper_cylinder(), p, Drive::kDirect, down_to(3, -1.5)).rows, 0.4);
  };
  const Plateau without = steady(false), with = steady(true);
  std::printf("trailing elements: force %+.1f %%, torque %+.1f %%\n",
              100 * (with.force.y() / without.force.y() - 1),
              100 * (with.torque / without.torque - 1));
  EXPECT_GT(with.force.y(), 1.02 * without.force.y());
  EXPECT_LT(with.torque, 0.98 * without.torque);
}

TEST(VoxelEngine, ContactDependsOnThePlaceOfTheBurNotOnItsWay) {
  // An engine that follows a bur along axes of the lattice, aslant, by jumps and turns, there and
  // back, meets what one does that looks for the first time.
  const LayeredTooth tooth = block(0.1, 1, Vec3(4, 4, 4));
  Workpiece workpiece(tooth);
  const Bur bur = paper_cylinder();
  const Vec3 v(0, -1, 0.2);
  Pose pose{Vec3(0, -0.2, -1.5), Quat::Identity()};
  VoxelEngine follows(bur, workpiece, voxel_parameters(), pose);
  const auto expect_same = [&] {
    VoxelEngine anew(bur, workpiece, voxel_parameters(), pose);
    follows.sample(pose, v, Vec3::Zero());
    anew.sample(pose, v, Vec3::Zero());
    ASSERT_GT(anew.contact().size(), 0);
    ASSERT_EQ(follows.contact().size(), anew.contact().size());
    const GrindingResponse a = follows.contact().response(v, Vec3::Zero(), 100);
    const GrindingResponse b = anew.contact().response(v, Vec3::Zero(), 100);
    EXPECT_EQ(a.B, b.B);
    EXPECT_EQ(a.b, b.b);
  };
  for (const Vec3& move : {Vec3(0, -0.003, 0), Vec3(0, 0, 0), Vec3(0.001, -0.002, 0.0015),
                           Vec3(-0.004, 0.001, 0), Vec3(0.05, -0.02, 0.03), Vec3(0, 0.003, 1e-12)})
    for (int n = 0; n < 40; ++n) {
      pose.position += n < 25 ? move : Vec3(-move);
      if (n == 30)
        pose.orientation =
            pose.orientation * Quat(Eigen::AngleAxisd(0.02, (move + v).normalized()));
      expect_same();
    }
}

TEST(VoxelEngine, ContactIsThatOfTheCutWhoeverCutsIt) {
  const LayeredTooth tooth = block(0.1, 4, Vec3(3, 4, 5));
  const Bur bur = paper_cylinder();
  Workpiece workpiece(tooth);
  const Vec3 down(0, -0.5, 0);
  Pose pose;
  pose.position = Vec3(0, 0.1, -1.5);
  VoxelEngine engine(bur, workpiece, voxel_parameters(), pose);
  engine.sample(pose, down, Vec3::Zero());
  const int before = engine.contact().size();
  const auto met = [&](const Pose& at) {
    int count = 0;
    engine.for_met(at, [&](std::size_t, int, int) { ++count; });
    return count;
  };
  EXPECT_GT(before, 0);
  EXPECT_EQ(met(pose), before);
  // Another one, half a bur deeper.
  Pose deeper = pose;
  deeper.position.y() -= 0.6;
  VoxelEngine(bur, workpiece, voxel_parameters(), deeper).clear(deeper);
  const int left = met(pose);
  EXPECT_LT(left, before);
  EXPECT_EQ(engine.contact().size(), before);  // of the last sample()
  Pose away = pose;
  away.position.y() += 2;
  EXPECT_EQ(met(away), 0);
  engine.sample(pose, down, Vec3::Zero());
  EXPECT_EQ(engine.contact().size(), left);
  VoxelEngine fresh(bur, workpiece, voxel_parameters(), pose);
  fresh.sample(pose, down, Vec3::Zero());
  EXPECT_EQ(fresh.contact().size(), left);
  EXPECT_EQ(engine.contact().response(down, Vec3::Zero(), 1).B,
            fresh.contact().response(down, Vec3::Zero(), 1).B);
}

TEST(VoxelEngine, ReplayTwiceGivesTheSameBits) {
  const LayeredTooth tooth = block(0.1, 1, Vec3(4, 4, 4));
  const auto path = straight_path({Vec3(0.02, 0.7, -1.5), Vec3(0.4, -2, -1.3)}, 1.0);
  const Outcome a = run(tooth, paper_cylinder(), voxel_parameters(), Drive::kCoupled, path);
  const Outcome b = run(tooth, paper_cylinder(), voxel_parameters(), Drive::kCoupled, path);
  for (std::size_t i = 0; i < a.rows.size(); ++i)
    ASSERT_EQ(a.rows[i].grinding_force, b.rows[i].grinding_force) << i;
}

TEST(LiteralReading, StallJudgedOnTheLastTorqueChattersEverySecondStep) {
  // A stalled bur has v = 0, hence T = 0, hence is free again: half of the steps stall and the bur
  // creeps, where judged on the trial it stands still.
  for (const EngineKind engine : {EngineKind::kLevelset, EngineKind::kVoxel}) {
    Parameters p = preset_parameters("paper");
    p.engine = engine;
    p.coupling.stiffness = 20;  // a stiff spring reaches the stall soon
    p.handpiece.stall_rule = StallRule::kLastStep;
    const LayeredTooth tooth = block(0.1, 4, Vec3(3, 4, 5));
    const auto path = straight_path({Vec3(0, -0.7, -1.5), Vec3(0, -2.7, -1.5)}, 1.2);
    const Outcome literal = run(tooth, paper_cylinder(), p, Drive::kCoupled, path);
    p.handpiece.stall_rule = StallRule::kTrial;
    const Outcome ours = run(tooth, paper_cylinder(), p, Drive::kCoupled, path);
    EXPECT_EQ(ours.totals.stall_onsets, 1);
    EXPECT_GT(literal.totals.stall_onsets, 300);
    // From the first stall on, every second step is stalled: none is like the one before it.
    std::size_t first = 0;
    while (first < literal.rows.size() && !literal.rows[first].stalled) ++first;
    ASSERT_LT(first + 600, literal.rows.size());
    long alike = 0;
    for (std::size_t i = first + 1; i < literal.rows.size(); ++i)
      alike += literal.rows[i].stalled == literal.rows[i - 1].stalled;
    EXPECT_LE(alike, 2) << "of " << literal.rows.size() - first << " steps";
  }
}

TEST(LiteralReading, AttachedWithoutContactTheBurIsTheHandle) {
  Parameters p = paper_without_stall();
  p.coupling.attached_without_contact = true;
  // In the air above the block: no lag at all, where the spring would leave m v / h k.
  const Outcome r =
      run(block(0.1, 4, Vec3(3, 4, 5)), paper_cylinder(), p, Drive::kCoupled, down_to(2, -1.5));
  for (std::size_t i = 1; i < r.rows.size(); ++i) {
    const StepRecord& row = r.rows[i];
    if (row.handle.pose.position.y() < 0.61) break;
    EXPECT_EQ(row.bur.position, row.handle.pose.position);
    EXPECT_EQ(row.device_force, Vec3::Zero());
  }
  // In the tissue it hangs on the spring.
  EXPECT_GT(r.totals.largest_lag, 1.0);
}

TEST(LiteralReading, OptionsThatNeedTheVoxelEngineSaySo) {
  Parameters p = preset_parameters("paper");
  p.trailing_elements = true;
  EXPECT_THROW(validate(p), Error);
  p.engine = EngineKind::kVoxel;
  EXPECT_NO_THROW(validate(p));
  p.handpiece.stall_rule = StallRule::kLastStep;
  p.handpiece.model = HandpieceModel::kDroop;
  EXPECT_THROW(validate(p), Error);
}

}  // namespace
}  // namespace toothprep::testing
