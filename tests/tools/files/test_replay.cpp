// A session that was recorded while it ran gives the same bits when its recording is replayed.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>

#include "recording_cases.h"
#include "toothprep/proof/specimen/block.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/session/replay.h"
#include "toothprep/tools/files/session_recorder.h"
#include "toothprep/tools/files/trace_columns.h"

namespace toothprep {
namespace {

using testing::kStep;
using testing::ScratchFile;

constexpr int kReplayRows = 2500;

LayeredTooth enamel_block() {
  BlockOptions o;
  o.size = Vec3(4, 4, 4);
  o.enamel = 4;
  return make_block(o);
}

// A hand that presses a cylinder into the block's top face, sways, trembles and turns, with the
// pedal up for a while. Turns are products of rotations, brought to unit length as a live session
// does.
HandleSample hand(int i, double start) {
  const double t = i * kStep, turn = 2 * std::numbers::pi * t;
  HandleSample s;
  s.time = start + i * kStep;
  s.pose.position =
      Vec3(0.8 * std::sin(0.7 * turn) + 0.02 * std::sin(9 * turn),
           0.75 - 0.6 * std::min(t, 1.8) + 3 * std::max(t - 2.1, 0.0) + 0.05 * std::sin(8.3 * turn),
           0.9 + 0.3 * std::cos(turn));
  s.pose.orientation = (Quat(Eigen::AngleAxisd(0.25 * std::sin(1.3 * turn), Vec3::UnitX())) *
                        Quat(Eigen::AngleAxisd(0.4 * std::sin(0.9 * turn), Vec3::UnitY())))
                           .normalized();
  s.buttons = i > 1200 && i < 1300 ? 0u : kPedalButton;
  return s;
}

void expect_same_bits(const std::vector<StepRecord>& live, const std::vector<StepRecord>& again) {
  ASSERT_EQ(live.size(), again.size());
  for (std::size_t i = 0; i < live.size(); ++i)
    for (const TraceColumn& column : trace_columns()) {
      std::array<double, 4> a{}, b{};
      column.get(live[i], a.data());
      column.get(again[i], b.data());
      ASSERT_EQ(std::memcmp(a.data(), b.data(), sizeof a), 0)
          << column.dataset << ", row " << i << ": " << a[0] << ", " << b[0];
    }
}

void record_and_replay(Drive drive, EngineKind engine, double start) {
  const ScratchFile file("replay");
  const LayeredTooth tooth = enamel_block();
  const Bur bur = make_bur("cylinder:D1.2xL3.0", "");
  Parameters parameters = preset_parameters("paper");
  parameters.time_step = kStep;
  parameters.engine = engine;
  std::vector<StepRecord> live;
  SessionTotals totals;
  {
    Workpiece workpiece(tooth);
    Session session(bur, workpiece, parameters, drive, hand(0, start));
    SessionHeader header = testing::synthetic_header();
    header.trace.parameters_toml = to_toml(parameters);
    SessionRecorder recorder(file.path, header);
    LiveTick tick;
    tick.row = session.initial();
    // A tick is handed on when the next one is there: finish() still adds to the last.
    for (int i = 1; i < kReplayRows; ++i) {
      ASSERT_TRUE(recorder.push(tick));
      live.push_back(tick.row);
      tick.row = session.step(hand(i, start));
    }
    session.finish(tick.row);
    ASSERT_TRUE(recorder.push(tick));
    live.push_back(tick.row);
    totals = session.totals();
    recorder.finish({{totals.torque_work, 0, 0}, "duration"});
  }
  const SessionRecording recording = read_session(file.path);
  expect_same_bits(live, recording.header.trace.rows);

  // As `toothprep replay --trajectory` does, with the recording's own parameters.
  const std::vector<HandleSample> path =
      resample(read_h5_trajectory(file.path), parameters.time_step, false, file.path);
  Workpiece workpiece(tooth);
  const ReplayResult again =
      replay(bur, workpiece, parse_parameters(recording.header.trace.parameters_toml, file.path),
             drive, path);
  expect_same_bits(live, again.rows);
  EXPECT_EQ(again.totals.torque_work, totals.torque_work);
  EXPECT_EQ(again.totals.removed, totals.removed);

  // It was worth it: it cut, it touched, it ran free, the pedal was up.
  EXPECT_GT(totals.removed[0], 0.05);
  EXPECT_GT(totals.contact_steps, 300);
  EXPECT_LT(totals.contact_steps, kReplayRows - 50);
}

TEST(Replay, OfARecordingGivesTheSameBits) {
  record_and_replay(Drive::kCoupled, EngineKind::kLevelset, 0);
}

TEST(Replay, OfARecordingThatStartsLateGivesTheSameBits) {
  record_and_replay(Drive::kCoupled, EngineKind::kLevelset, 17 * kStep);
}

TEST(Replay, OfADirectDriveAndOfTheVoxelEngineGivesTheSameBits) {
  record_and_replay(Drive::kDirect, EngineKind::kLevelset, 0);
  record_and_replay(Drive::kCoupled, EngineKind::kVoxel, 0);
}

}  // namespace
}  // namespace toothprep
