// Whole sessions with all their threads: servo, watch, recorder, display, driver; also under ThreadSanitizer.
#include <gtest/gtest.h>

#include <atomic>
#include <filesystem>
#include <thread>

#include "../device/rig.h"
#include "../live/live_experiment.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/display/display_surface.h"
#include "toothprep/tools/files/session_file.h"
#include "toothprep/tools/live_session/live_session.h"

namespace toothprep::testing {
namespace {

namespace fs = std::filesystem;

// Until so many steps were made, or something ended it. Under a sanitizer a tick may take longer than its period.
class Experiment {
 public:
  explicit Experiment(long steps)
      : path_(fs::temp_directory_path() / ("live-session-" + name() + ".h5")) {
    settings.parameters = preset_parameters("paper");
    settings.registration = same_frame();
    settings.start = Vec3(-4.8, -2, 0);
    settings.limits = no_watch();
    settings.limits.ramp = 0.02;
    settings.display_hz = 100;
    settings.readings.frozen_after = 10;
    settings.readings.gap = 10;
    settings.watch.stale = 10;
    settings.watch.duration = 60;
    settings.watch.stop_asked = [this, steps] { return steps_ >= steps; };
    settings.watch.report = [this](const LiveStatus& s, const DeviceStatus&) { steps_ = s.steps; };
    settings.watch.note = [this](const std::string& line) { notes += line + "\n"; };
  }
  ~Experiment() { fs::remove(path_); }

  LiveOutcome on(HapticDevice& device) {
    const LayeredTooth tooth = enamel_block();
    Workpiece workpiece(tooth);
    RecordTarget target;
    target.path = path_;
    target.replace = true;
    return run_live_session(device, paper_cylinder(), tooth, workpiece, settings, target);
  }
  SessionRecording recording() const { return read_session(path_); }

  LiveSettings settings;
  std::string notes;

 private:
  static std::string name() {
    return std::string(::testing::UnitTest::GetInstance()->current_test_info()->name()) + "-" +
           std::to_string(getpid());
  }
  std::string path_;
  long steps_ = 0;
};

SimulatedSettings hand_into_the_block() {
  SimulatedSettings settings;
  settings.motion = [](double time) {
    DevicePose pose;
    pose.position = Vec3(-4.8 + 2 * time, -2, 0);
    pose.orientation = orientation_of_axis(Vec3(0, 1, 0));
    pose.buttons = 1;
    return pose;
  };
  return settings;
}

TEST(LiveSession, RecordsWhatItWasLimitedByAndWhereTheHandWas) {
  Experiment run(300);
  run.settings.registration.translation.reset();
  run.settings.registration.rotation = Quat(Eigen::AngleAxisd(0.5, Vec3::UnitY()));
  run.settings.limits.thermal_time = 7;
  run.settings.limits.vibration_time = 0.07;
  run.settings.readings.speed = 1500;
  SimulatedDevice device(hand_into_the_block());
  const LiveOutcome outcome = run.on(device);
  EXPECT_EQ(outcome.run.end.reason, "asked to stop");
  EXPECT_EQ(outcome.run.failure, "");
  const SessionRecording r = run.recording();
  ASSERT_TRUE(r.header.safety);
  EXPECT_EQ(r.header.safety->force_ramp, 0.02);
  EXPECT_EQ(r.header.safety->force_fade, 0.05);
  EXPECT_EQ(r.header.safety->heat_time, 7);
  EXPECT_EQ(r.header.safety->vibration_time, 0.07);
  EXPECT_EQ(r.header.safety->stale, 10);
  EXPECT_EQ(r.header.safety->speed, 1500);
  EXPECT_EQ(r.header.safety_switch, "used");
  ASSERT_TRUE(r.header.registration_hand);
  EXPECT_EQ(r.header.registration_hand->position, r.device_position.front());
  // The hand starts at the given place, wherever the device's handle was.
  const Vec3 start = r.header.registration.orientation * r.device_position.front() +
                     r.header.registration.position;
  EXPECT_LT((start - run.settings.start).norm(), 1e-12);
}

TEST(LiveSession, CutsAndShowsAndRecordsOnSixThreads) {
  Experiment run(1500);
  SimulatedDevice device(hand_into_the_block());
  std::atomic<bool> over = false;
  std::thread other([&] {
    while (!over) {
      (void)device.status();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  const LiveOutcome outcome = run.on(device);
  over = true;
  other.join();
  ASSERT_TRUE(outcome.totals);
  EXPECT_GT(outcome.totals->removed[0], 0);
  EXPECT_GT(outcome.display->blocks, 0);
  EXPECT_EQ(static_cast<std::int64_t>(run.recording().servo_time.size()), outcome.run.ticks.ticks);
}

TEST(LiveSession, AnOnlookerGetsEveryTickBetweenItsBeginningAndItsEnd) {
  struct Counter final : Onlooker {
    void begin(const DisplaySurface& display) override {
      EXPECT_EQ(takes, 0);
      triangles = display.mesh().triangles.size();
    }
    void take(const LiveTick& tick) noexcept override {
      ++takes;
      last_time = tick.row.handle.time;
    }
    void end() noexcept override { takes_at_end = takes; }
    std::int64_t takes = 0, takes_at_end = -1;
    double last_time = 0;
    std::size_t triangles = 0;
  } onlooker;
  Experiment run(300);
  run.settings.onlooker = &onlooker;
  SimulatedDevice device(hand_into_the_block());
  const LiveOutcome outcome = run.on(device);
  EXPECT_EQ(onlooker.takes, outcome.run.ticks.ticks);
  EXPECT_EQ(onlooker.takes_at_end, onlooker.takes);
  EXPECT_EQ(onlooker.last_time, run.recording().header.trace.rows.back().handle.time);
  EXPECT_GT(onlooker.triangles, 0);
}

TEST(LiveSession, OnTheVendorsInterfaceGoesThroughFaultsOfEveryKind) {
  const auto fault = [](const char* what, int at, int ticks) {
    return std::string("[[fault]]\nwhat = \"") + what + "\"\nat_tick = " + std::to_string(at) +
           "\nticks = " + std::to_string(ticks) + "\n";
  };
  StandIn::get().set_up("[hand]\nmotion = \"gentle\"\n" + fault("pose-jump", 100, 3) +
                        fault("nan", 200, 3) + fault("let-go", 300, 50) +
                        fault("warm-motors", 400, 50) + fault("comm-error", 700, 1));
  OpenHapticsSettings settings;
  settings.library = TOOTHPREP_STAND_IN;
  Experiment run(100000);
  run.settings.registration.translation.reset();
  run.settings.start = Vec3(0, 20, 0);
  const auto device = open_openhaptics(settings);
  const LiveOutcome outcome = run.on(*device);
  EXPECT_TRUE(outcome.run.end.fault);
  for (const char* words :
       {"jumped as no hand does", "not finite", "nobody holds", "held again", "too warm"})
    EXPECT_NE(run.notes.find(words), std::string::npos) << words << " in:\n" << run.notes;
  EXPECT_NE(outcome.run.end.reason.find("does not answer"), std::string::npos);
  const SessionRecording r = run.recording();
  const auto count = [&](std::uint32_t flag) {
    return std::count_if(r.flags.begin(), r.flags.end(), [&](auto flags) { return flags & flag; });
  };
  // As many as the machine didn't leave out.
  EXPECT_GE(count(kReadingRejected), 2);
  EXPECT_LE(count(kReadingRejected), 6);
  EXPECT_GT(count(kSwitchOpen), 20);
  EXPECT_LE(count(kSwitchOpen), 50);
  EXPECT_EQ(count(kSwitchHeld) + count(kSwitchOpen), static_cast<long>(r.flags.size()));
}

}  // namespace
}  // namespace toothprep::testing
