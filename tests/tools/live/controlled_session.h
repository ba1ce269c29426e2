// A live session on the simulated device that is paused, taken back and changed, tick by tick.
#pragma once

#include <gtest/gtest.h>

#include "live_experiment.h"

namespace toothprep::testing {

// Into the block for 3 s, out again, 0.5 s of rest beside it, and into it anew.
inline HandMotion in_and_out_and_in() {
  return [](double t) {
    const double x = t < 3 ? 2 * t : t < 4 ? 6 - 6 * (t - 3) : t < 4.5 ? 0 : 2 * (t - 4.5);
    DevicePose pose;
    pose.position = Vec3(-4.8 + x, -2, 0);
    pose.orientation = orientation_of_axis(Vec3(0, 1, 0));
    return pose;
  };
}

// What a session's main thread does, by hand, on a device that is computed tick by tick.
class Controlled {
 public:
  Controlled() : device_(settings()), loop(no_watch(), {}, &rows), workpiece_(tooth) {
    burs.burs = {paper_cylinder(), make_bur("ball:D1.2", "")};
    device_.start(loop);
    device_.run(1);
    const DevicePose hand = *loop.waiting_pose();
    const HandleFrame frame(same_frame(), hand.position, Vec3::Zero());
    HandleSample first;
    first.pose = frame.to_world(hand.position, hand.orientation);
    loop.begin(intervals.begin(burs.burs[0], first), frame, same_frame(), {}, 1e-3);
  }
  void run(int ticks) { device_.run(ticks); }
  void post(EventKind kind, LiveCommand command = {}) {
    command.kind = kind;
    ASSERT_TRUE(loop.post(command));
    run(1);
    EXPECT_FALSE(loop.posted());
  }
  void pause() {
    post(EventKind::kPause);
    run(100);
    ASSERT_TRUE(loop.paused());
    intervals.end();
  }
  void undo() {
    ASSERT_TRUE(intervals.undo());
    LiveCommand command;
    command.removed = intervals.removed_before();
    post(EventKind::kUndo, command);
  }
  void change_bur() {
    LiveCommand command;
    command.arguments[0] = bur_ = 1;
    post(EventKind::kBur, command);
  }
  void resume() {
    HandleSample first;
    first.pose = loop.paused_handle();
    LiveCommand command;
    command.session = &intervals.begin(burs.burs[bur_], first);
    command.removed = intervals.removed_before();
    post(EventKind::kResume, command);
  }
  void finish() {
    device_.stop();
    loop.finish();
  }
  // The rows of a replay of what was recorded.
  std::vector<StepRecord> replayed() {
    std::vector<HandleSample> path;
    for (const LiveTick& tick : rows.ticks) {
      path.push_back(tick.row.handle);
      if (tick.event.kind == EventKind::kNone) continue;
      burs.events.push_back(tick.event);
      burs.events.back().time = tick.row.handle.time;
    }
    Workpiece fresh(tooth);
    const ReplayResult result =
        replay(burs.burs[0], fresh, preset_parameters("paper"), Drive::kCoupled, path, {}, burs);
    totals = result.totals;
    ground = result.ground;
    return result.rows;
  }

  const LayeredTooth tooth = enamel_block();
  Interventions burs;
  Rows rows;

 private:
  static SimulatedSettings settings() {
    SimulatedSettings s;
    s.real_time = false;
    s.motion = in_and_out_and_in();
    return s;
  }
  SimulatedDevice device_;

 public:
  LiveLoop loop;

 private:
  Workpiece workpiece_;
  std::size_t bur_ = 0;

 public:
  Intervals intervals{workpiece_, preset_parameters("paper"), Drive::kCoupled};
  SessionTotals totals;
  PerTissue<double> ground{};
};

}  // namespace toothprep::testing
