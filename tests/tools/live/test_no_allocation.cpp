// The servo tick of a live session allocates nothing, counted as calls of operator new.
#include <gtest/gtest.h>

#include "../../support/allocation_counter.h"
#include "controlled_session.h"

namespace toothprep::testing {
namespace {

TEST(NoAllocation, LiveTicksThatGrindAllocateNothing) {
  SimulatedSettings settings;
  settings.real_time = false;
  settings.motion = hand_along(slot(2, 4));
  SimulatedDevice device(settings);
  Rows rows;
  LiveLoop loop(no_watch(), {0, 2}, &rows);
  device.start(loop);
  device.run(1);
  const DevicePose first = *loop.waiting_pose();
  const HandleFrame frame(same_frame(), first.position, Vec3::Zero());
  const Bur bur = paper_cylinder();
  const LayeredTooth tooth = enamel_block();
  Workpiece workpiece(tooth);
  HandleSample at;
  at.pose = frame.to_world(first.position, first.orientation);
  Session session(bur, workpiece, preset_parameters("paper"), Drive::kCoupled, at);
  loop.begin(session, frame, same_frame(), {}, 1e-3);
  const long before = allocations;
  device.run(3000);
  EXPECT_EQ(allocations, before);
  device.stop();
  EXPECT_GT(session.totals().removed[0], 0.1);
  EXPECT_EQ(rows.ticks.size(), 2999u);  // the last one waits for finish()
}

TEST(NoAllocation, PauseAndResumeAllocateNothingOnTheServosThread) {
  Controlled c;
  c.run(2900);
  long before = allocations;
  LiveCommand pause;
  pause.kind = EventKind::kPause;
  c.loop.post(pause);
  c.run(100);
  EXPECT_EQ(allocations, before);
  ASSERT_TRUE(c.loop.paused());
  c.intervals.end();
  c.run(1300);
  c.undo();
  HandleSample first;
  first.pose = c.loop.paused_handle();
  LiveCommand resume;
  resume.kind = EventKind::kResume;
  resume.session = &c.intervals.begin(c.burs.burs[0], first);
  before = allocations;
  c.loop.post(resume);
  c.run(3000);
  EXPECT_EQ(allocations, before);
}

}  // namespace
}  // namespace toothprep::testing
