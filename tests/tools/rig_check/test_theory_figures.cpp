#include <gtest/gtest.h>

#include "../../step/session/experiment.h"
#include "made_recording.h"
#include "toothprep/step/session/replay.h"
#include "toothprep/tools/rig_check/rig_figures.h"

namespace toothprep {
namespace {

using testing::made_recording;

const RigMethod kMethod;

DeviceTraits desktop() {
  DeviceTraits d;
  d.name = "Phantom Desktop";
  d.apparent_mass = 45e-6;
  d.damping = 0.05e-3;
  d.friction = 0.06;
  d.encoder_count = 0.023;
  return d;
}

// By hand: 2 b/T = 2 * 0.05e-3/1e-3; with the grip 2 * 2.05; 2 f_c/D = 0.12/0.023;
// m v/D = 45e-6 * 0.5/0.023; 2 f_c T/D; 2 m/T.
TEST(Stability, LimitsOfADesktopByHand) {
  const DeviceTraits device = desktop();
  const auto f =
      stability_figures(made_recording(1000), preset_parameters("paper"), &device, kMethod);
  ASSERT_TRUE(f);
  EXPECT_FALSE(f->count_measured);
  EXPECT_NEAR(f->limit_device, 0.1, 1e-12);
  EXPECT_NEAR(f->limit_hand, 4.1, 1e-12);
  EXPECT_NEAR(f->limit_friction, 5.2174, 1e-4);
  EXPECT_NEAR(f->coupling_margin, 5.2174, 1e-4);
  EXPECT_NEAR(f->limit_counts, 0.978e-3, 1e-6);
  EXPECT_NEAR(f->limit_count_friction, 5.2174e-3, 1e-7);
  EXPECT_NEAR(f->limit_linear, 90e-3, 1e-9);
  EXPECT_FALSE(f->tooth_damping);
  EXPECT_FALSE(f->direct_margin);
}

// A delay of d ticks: b/(T/2 + d T); the damper's linear limit falls to 0.828 m/T at d = 1.
TEST(Stability, DelayLowersTheLimits) {
  DeviceTraits device = desktop();
  device.delay_ticks = 1;
  const auto f =
      stability_figures(made_recording(1000), preset_parameters("paper"), &device, kMethod);
  EXPECT_NEAR(f->limit_hand, 2.05e-3 / 1.5e-3, 1e-12);
  EXPECT_NEAR(f->limit_linear, 0.8284 * 45e-3, 1e-5);
}

TEST(Stability, AMeasuredCountTakesPrecedenceAndTheToothsDampingGivesTheDirectMargin) {
  SessionRecording r = made_recording(2000);
  for (std::size_t i = 0; i < 2000; ++i) {
    r.device_position[i][0] = i % 2 ? 0.05 : 0;  // counts of 0.05 mm
    if (i < 1000) continue;
    r.header.trace.rows[i].bur_velocity = Vec3(0.4, 0, 0);
    r.header.trace.rows[i].grinding_force = Vec3(-0.8, 0, 0);
    r.header.trace.rows[i].torque = 0.3;
  }
  const DeviceTraits device = desktop();
  const auto f = stability_figures(r, preset_parameters("paper"), &device, kMethod);
  ASSERT_TRUE(f);
  EXPECT_TRUE(f->count_measured);
  EXPECT_NEAR(f->count, 0.05, 1e-12);
  EXPECT_NEAR(f->limit_friction, 2.4, 1e-12);
  EXPECT_NEAR(f->speed, 0.4, 1e-12);
  EXPECT_NEAR(*f->tooth_damping, 2, 1e-12);
  EXPECT_NEAR(*f->direct_margin, 2.4e-3 / 2, 1e-12);  // 2 f_c T/D over B
}

TEST(Stability, AnUnknownDeviceIsSaid) {
  EXPECT_FALSE(
      stability_figures(made_recording(100), preset_parameters("paper"), nullptr, kMethod));
}

class Replay : public ::testing::Test {
 protected:
  // A cut of 0.3 s into enamel, recorded.
  void SetUp() override {
    recording = made_recording(301);
    const auto path = testing::straight_path({Vec3(0, 0.61, -1.5), Vec3(0, 0.01, -1.5)}, 2.0);
    for (std::size_t i = 0; i <= 300; ++i)
      recording.header.trace.rows[i].handle = path[std::min(i, path.size() - 1)];
    for (std::size_t i = 0; i <= 300; ++i)
      recording.header.trace.rows[i].handle.time = static_cast<double>(i) * 1e-3;
    recording.header.trace.rows = run();
  }
  std::vector<StepRecord> run() const {
    std::vector<HandleSample> handle;
    for (const StepRecord& row : recording.header.trace.rows) handle.push_back(row.handle);
    LayeredTooth tooth = testing::block(0.2, 8);
    Workpiece workpiece(tooth);
    return replay(testing::paper_cylinder(), workpiece, preset_parameters("paper"), Drive::kCoupled,
                  handle)
        .rows;
  }
  SessionRecording recording;
};

TEST_F(Replay, TheSamePathGivesTheSameBits) {
  const auto rows = run();
  EXPECT_GT(rows.back().device_force.norm(), 0.05);
  const auto f = compare_replay(recording, rows);
  ASSERT_TRUE(f);
  EXPECT_EQ(f->rows, 301);
  EXPECT_EQ(f->differing, 0);
  EXPECT_EQ(f->largest_force, 0);
}

TEST_F(Replay, OneBitIsFoundWithItsPlace) {
  auto rows = run();
  double& force = recording.header.trace.rows[200].device_force[1];
  const double before = force;
  force = std::nextafter(force, 100);
  recording.header.trace.rows[250].torque += 1e-3;
  const auto f = compare_replay(recording, rows);
  ASSERT_TRUE(f);
  EXPECT_EQ(f->differing, 2);
  EXPECT_DOUBLE_EQ(f->first_at, 0.2);
  EXPECT_EQ(f->first_what, "the device's force");
  EXPECT_EQ(f->largest_force, force - before);
  EXPECT_NEAR(f->largest_torque, 1e-3, 1e-15);
}

TEST_F(Replay, TheLastRowOfAKilledSessionMayLackWhatIsRemovedAtTheEnd) {
  const auto rows = run();
  recording.header.trace.rows.back().removed_volume[0] *= 0.5;
  EXPECT_EQ(compare_replay(recording, rows)->differing, 1);
  recording.complete = false;
  EXPECT_EQ(compare_replay(recording, rows)->differing, 0);
}

TEST_F(Replay, MissingRowsMakeItImpossible) {
  testing::erase_row(recording, 100);
  EXPECT_EQ(compare_replay(recording, run()).why_not, "1 ticks lack that the recorder dropped");
}

}  // namespace
}  // namespace toothprep
