// The tooth at every moment of a session, in any order.
#include <gtest/gtest.h>

#include <map>
#include <thread>
#include <tuple>

#include "../display/slot.h"
#include "toothprep/step/session/replay.h"
#include "toothprep/tools/display/display_surface.h"
#include "toothprep/tools/view/key_frames.h"
#include "toothprep/tools/view/rerun.h"

namespace toothprep::testing {
namespace {

constexpr double kFast = 30;  // mm/s: 220 steps for the slot

// What a viewer has who replaces blocks by those that come.
class Viewer {
 public:
  void take(std::vector<BlockMesh> blocks) {
    for (BlockMesh& b : blocks) {
      const auto key = std::tuple(b.block.x(), b.block.y(), b.block.z());
      if (b.mesh.triangles.empty())
        blocks_.erase(key);
      else
        blocks_[key] = std::make_shared<const BlockMesh>(std::move(b));
    }
  }
  DisplayMesh mesh() const {
    std::vector<std::shared_ptr<const BlockMesh>> all;
    for (const auto& [key, block] : blocks_) all.push_back(block);
    return join_blocks(all);
  }

 private:
  std::map<std::tuple<int, int, int>, std::shared_ptr<const BlockMesh>> blocks_;
};

void expect_same(const DisplayMesh& a, const DisplayMesh& b) {
  EXPECT_EQ(a.vertices, b.vertices);
  EXPECT_EQ(a.normals, b.normals);
  EXPECT_EQ(a.tissue, b.tissue);
  EXPECT_EQ(a.triangles, b.triangles);
}

struct Slot {  // cut once, with the surface at every 20th step as a display shows it
  LayeredTooth tooth = slot_block();
  Bur bur = slot_bur();
  std::vector<HandleSample> path = slot_path(kFast);
  Workpiece workpiece{tooth};
  KeyFrames frames{workpiece};
  std::vector<DisplayMesh> expected;

  explicit Slot(EngineKind engine) {
    // A second workpiece under the same session, since taking what changed is for one taker.
    Workpiece shown(tooth);
    Session session(bur, workpiece, slot_parameters(engine), Drive::kDirect, path.front());
    Session twin(bur, shown, slot_parameters(engine), Drive::kDirect, path.front());
    expected.push_back(DisplaySurface(shown).mesh());
    for (std::size_t i = 1; i < path.size(); ++i) {
      session.step(path[i]);
      twin.step(path[i]);
      if (i % 20 != 0) continue;
      frames.add(workpiece);
      expected.push_back(DisplaySurface(shown).mesh());
    }
  }
};

class KeyFramesOf : public ::testing::TestWithParam<EngineKind> {};

TEST_P(KeyFramesOf, AreTheSurfaceOfTheirMomentInAnyOrder) {
  Slot slot(GetParam());
  const int last = slot.frames.frames() - 1;
  ASSERT_GE(last, 9);
  EXPECT_NE(slot.expected.front().vertices, slot.expected.back().vertices);
  for (const int frame : {last, 0, 5, 3, last, 1})
    expect_same(join_blocks([&] {
                  std::vector<std::shared_ptr<const BlockMesh>> all;
                  for (BlockMesh& b : slot.frames.blocks(frame, -1))
                    all.push_back(std::make_shared<const BlockMesh>(std::move(b)));
                  return all;
                }()),
                slot.expected[static_cast<std::size_t>(frame)]);
}

TEST_P(KeyFramesOf, ChangedBlocksAloneBringAViewerFromAnyFrameToAnyOther) {
  Slot slot(GetParam());
  const int last = slot.frames.frames() - 1;
  Viewer viewer;
  int seen = -1;
  for (const int frame : {0, 4, 4, last, 2, 7, 0, last}) {
    std::vector<BlockMesh> blocks = slot.frames.blocks(frame, seen);
    if (frame == seen) {
      EXPECT_TRUE(blocks.empty());
    }
    viewer.take(std::move(blocks));
    seen = frame;
    expect_same(viewer.mesh(), slot.expected[static_cast<std::size_t>(frame)]);
  }
}
INSTANTIATE_TEST_SUITE_P(Engines, KeyFramesOf,
                         ::testing::Values(EngineKind::kLevelset, EngineKind::kVoxel),
                         [](const auto& i) {
                           return i.param == EngineKind::kLevelset ? "Levelset" : "Voxel";
                         });

Recording slot_recording(const LayeredTooth& tooth) {
  Recording r{slot_bur(),
              slot_parameters(EngineKind::kLevelset),
              Drive::kDirect,
              slot_path(kFast),
              {},
              {},
              {},
              {},
              {},
              {}};
  Workpiece workpiece(tooth);
  r.rows = replay(r.bur, workpiece, r.parameters, r.drive, r.path).rows;
  return r;
}

Rerun::Progress finished(const Rerun& rerun) {
  Rerun::Progress progress;
  while (!(progress = rerun.progress(0)).finished)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  return progress;
}

TEST(Rerun, EndsWithWhatTheReplayLeftAndHasItsRowsToTheBit) {
  const LayeredTooth tooth = slot_block();
  const Recording recording = slot_recording(tooth);
  Workpiece workpiece(tooth);
  replay(recording.bur, workpiece, recording.parameters, recording.drive, recording.path);

  Rerun rerun(recording, tooth);
  const Rerun::Progress progress = finished(rerun);
  EXPECT_EQ(progress.failure, "");
  EXPECT_EQ(progress.bur_difference, 0);
  EXPECT_EQ(progress.force_difference, 0);
  EXPECT_EQ(progress.done, 1);
  ASSERT_EQ(progress.frame_rows.size(), static_cast<std::size_t>(rerun.frames()));
  EXPECT_EQ(progress.frame_rows.back(), recording.rows.size() - 1);
  Viewer viewer;
  viewer.take(rerun.blocks(rerun.frames() - 1, -1));
  expect_same(viewer.mesh(), DisplaySurface(workpiece).mesh());
}

TEST(Rerun, SaysHowFarARecordingOfOtherParametersIsAway) {
  const LayeredTooth tooth = slot_block();
  Recording recording = slot_recording(tooth);
  recording.rows[100].device_force += Vec3(0, 0.25, 0);
  Rerun rerun(recording, tooth);
  EXPECT_NEAR(finished(rerun).force_difference, 0.25, 1e-12);
}

}  // namespace
}  // namespace toothprep::testing
