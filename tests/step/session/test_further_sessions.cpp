// Sessions on a tooth that was cut before: with the same bur, another one, the other engine, and after an undo.
#include <gtest/gtest.h>

#include <optional>

#include "experiment.h"
#include "toothprep/step/core/units.h"
#include "toothprep/step/session/intervals.h"

namespace toothprep::testing {
namespace {

constexpr double kDepth = 0.45;  // mm, of the first slot's tip
constexpr double kEnamel = 0.6;  // mm
constexpr double kAcross = 0.2;  // rad, lean
constexpr double kSpeed = 8;     // mm/s
constexpr const char* kSameBur = "cylinder:D1.2xL3.0";

Quat leant() {
  return Quat(Eigen::AngleAxisd(kAcross, Vec3::UnitX()) *
              Eigen::AngleAxisd(-units::kPi / 2, Vec3::UnitX()));
}

// Along the block at `z`, with the tip `depth` deep.
std::vector<HandleSample> along_block(double z, double depth) {
  std::vector<HandleSample> path =
      straight_path({Vec3(-2.5, -depth, z), Vec3(2.5, -depth, z)}, kSpeed);
  for (HandleSample& sample : path) sample.pose.orientation = leant();
  return path;
}
std::vector<HandleSample> first_slot() { return along_block(0, kDepth); }
std::vector<HandleSample> second_slot() { return along_block(0.2, kDepth + 0.15); }

LayeredTooth small_block() { return block(0.1, kEnamel, Vec3(2, 2, 3)); }

struct Cut {
  std::vector<Vec3> forces;
  double work = 0;  // mJ
  PerTissue<double> removed{};
};

Cut cut_along(Workpiece& workpiece, const std::vector<HandleSample>& path, const char* bur_name,
              EngineKind engine = EngineKind::kLevelset) {
  const Bur bur = make_bur(bur_name, "");
  Parameters parameters = paper_without_stall();
  parameters.engine = engine;
  Session session(bur, workpiece, parameters, Drive::kDirect, path.front());
  Cut cut;
  StepRecord row = session.initial();
  for (std::size_t i = 1; i < path.size(); ++i) {
    row = session.step(path[i]);
    cut.forces.push_back(row.grinding_force);
  }
  session.finish(row);
  cut.work = session.totals().torque_work;
  cut.removed = session.totals().removed;
  return cut;
}

double volume(const Cut& cut) { return cut.removed[0] + cut.removed[1]; }

TEST(FurtherSession, OnAToothThatKeepsItsCutFeelsBitForBitWhatTheSameWorkpieceGives) {
  LayeredTooth tooth = small_block();
  Workpiece whole(tooth);
  cut_along(whole, first_slot(), kSameBur);
  LayeredTooth left = tooth;
  apply_cut(left, whole);
  const Cut on_the_same = cut_along(whole, second_slot(), kSameBur);
  Workpiece again(left);
  const Cut on_what_was_left = cut_along(again, second_slot(), kSameBur);
  ASSERT_GT(volume(on_the_same), 0.3);
  ASSERT_GT(on_the_same.removed[1], 0.02) << "both tissues";
  ASSERT_EQ(on_what_was_left.forces.size(), on_the_same.forces.size());
  for (std::size_t i = 0; i < on_the_same.forces.size(); ++i)
    ASSERT_EQ(on_what_was_left.forces[i], on_the_same.forces[i]) << "step " << i;
  EXPECT_EQ(on_what_was_left.removed, on_the_same.removed);
  apply_cut(left, again);
  apply_cut(tooth, whole);
  EXPECT_EQ(tooth_sha256(left), tooth_sha256(tooth)) << "and leaves the same tooth";
}

TEST(FurtherSession, HasTheWorkOfOneLongSession) {
  const LayeredTooth tooth = small_block();
  const Bur bur = make_bur(kSameBur, "");
  Workpiece workpiece(tooth);
  std::vector<HandleSample> path = first_slot();
  Session session(bur, workpiece, paper_without_stall(), Drive::kDirect, path.front());
  for (const HandleSample& sample : path) session.step(sample);
  const double of_first = session.totals().torque_work;
  HandleSample over = second_slot().front();
  over.buttons = 0;  // to the second one with the motor off
  session.step(over);
  for (const HandleSample& sample : second_slot()) session.step(sample);
  const double of_second = session.totals().torque_work - of_first;

  LayeredTooth left = tooth;
  Workpiece first(tooth);
  cut_along(first, first_slot(), kSameBur);
  apply_cut(left, first);
  Workpiece second(left);
  EXPECT_NEAR(cut_along(second, second_slot(), kSameBur).work, of_second, 1e-4 * of_first);
}

// Without the intact tissues only nearly, by what remains of them.
TEST(FurtherSession, WithAnotherBurFeelsBitForBitWhatTheSameWorkpieceGives) {
  for (const bool keeps_tissues : {true, false}) {
    const LayeredTooth tooth = small_block();
    Workpiece whole(tooth);
    const Cut first = cut_along(whole, first_slot(), kSameBur);
    LayeredTooth left = tooth;
    apply_cut(left, whole);
    if (!keeps_tissues) left.parts->tissues.reset();
    const Cut on_the_same = cut_along(whole, second_slot(), "ball:D1.2");
    Workpiece again(left);
    const Cut on_what_was_left = cut_along(again, second_slot(), "ball:D1.2");
    if (keeps_tissues)
      EXPECT_EQ(on_what_was_left.forces, on_the_same.forces);
    else
      EXPECT_NEAR(on_what_was_left.work, on_the_same.work, 0.03 * first.work);
    const auto outline = [](const char* bur) { return outline_text(make_bur(bur, "").profile()); };
    EXPECT_EQ(left.parts->way->heads, std::vector{outline(kSameBur)});
    apply_cut(left, again);
    EXPECT_EQ(left.parts->way->heads, (std::vector{outline(kSameBur), outline("ball:D1.2")}));
    const Cut third = cut_along(whole, first_slot(), kSameBur);
    Workpiece once_more(left);
    EXPECT_LT(volume(cut_along(once_more, first_slot(), kSameBur)), 1e-3 * volume(first));
    EXPECT_LT(std::abs(third.work), 1e-3 * first.work) << "back in its own slot";
  }
}

TEST(FurtherSession, OfAToothWhoseCutIsNotKnownGoesByItsSolid) {
  const LayeredTooth tooth = small_block();
  Workpiece whole(tooth);
  const Cut first = cut_along(whole, first_slot(), kSameBur);
  LayeredTooth left = tooth;
  apply_remaining_solid(left, whole.remaining_solid());
  ASSERT_FALSE(left.parts);
  const Cut on_the_same = cut_along(whole, second_slot(), kSameBur);
  Workpiece again(left);
  const Cut on_what_was_left = cut_along(again, second_slot(), kSameBur);
  EXPECT_NEAR(volume(on_what_was_left), volume(on_the_same), 1e-3 * volume(first));
  EXPECT_NEAR(on_what_was_left.work, on_the_same.work, 0.05 * first.work);
}

TEST(FurtherSession, OfTheVoxelEngineDoesNotRemoveTwiceAndLeavesEarlierCutsAsTheyWere) {
  for (const EngineKind before : {EngineKind::kVoxel, EngineKind::kLevelset}) {
    LayeredTooth tooth = small_block();
    const double intact = volume_mm3(tooth.solid, tooth.lattice.voxel);
    Workpiece first(tooth);
    const Cut slot = cut_along(first, first_slot(), kSameBur, before);
    apply_cut(tooth, first);
    const double after_slot = volume_mm3(tooth.solid, tooth.lattice.voxel);
    ASSERT_LT(after_slot, intact - 0.5);
    Workpiece second(tooth);
    const Cut again = cut_along(second, first_slot(), kSameBur, EngineKind::kVoxel);
    EXPECT_LT(volume(again), 1e-9);
    EXPECT_FALSE(second.kept_way()) << "what it removes no straight parts tell";
    apply_cut(tooth, second);
    EXPECT_NEAR(volume_mm3(tooth.solid, tooth.lattice.voxel), after_slot, 1e-6 * volume(slot));
    Workpiece third(tooth);
    const Cut beside = cut_along(third, second_slot(), kSameBur, EngineKind::kVoxel);
    apply_cut(tooth, third);
    const double gone = after_slot - volume_mm3(tooth.solid, tooth.lattice.voxel);
    ASSERT_GT(volume(beside), 0.1);
    EXPECT_NEAR(gone, volume(beside), 0.1 * volume(beside));
  }
}

TEST(FurtherSession, AfterAnUndoFindsTheSlotBeforeIt) {
  const LayeredTooth tooth = small_block();
  Workpiece workpiece(tooth);
  const Bur bur = make_bur(kSameBur, "");
  Intervals intervals(workpiece, paper_without_stall(), Drive::kDirect);
  const auto interval = [&](const std::vector<HandleSample>& path) {
    Session& session = intervals.begin(bur, path.front());
    StepRecord row = session.initial();
    for (const HandleSample& sample : path) row = session.step(sample);
    session.finish(row);
    const double work = session.totals().torque_work;
    intervals.end();
    return work;
  };
  const double of_first = interval(first_slot());
  const LevelSet after_first = workpiece.cut();
  const double of_second = interval(second_slot());
  ASSERT_GT(of_second, 0.2 * of_first);
  ASSERT_TRUE(intervals.undo());
  for (std::size_t b = 0; b < after_first.table_size(); ++b)
    for (int v = 0; v < kBrickVoxels; ++v)
      ASSERT_EQ(workpiece.cut().brick(b)[v], after_first.brick(b)[v]);
  EXPECT_NEAR(interval(second_slot()), of_second, 0.002 * of_first);
}

}  // namespace
}  // namespace toothprep::testing
