// The stand-in is only worth something if it finds fault with wrong programs, and if what it is
// set to do wrong it does so.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>

#include "rig.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/device/libhd.h"

namespace toothprep::testing {
namespace {

using namespace hdapi;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

class StandInTest : public ::testing::Test {
 protected:
  void open(const std::string& toml = "") {
    stand_in.set_up("stepped = true\n" + toml);
    device = hd.hdInitDevice(HD_DEFAULT_DEVICE);
    ASSERT_NE(device, HD_INVALID_HANDLE);
  }
  // Runs `body` in one servo tick.
  void in_tick(const std::function<void()>& body) {
    const auto call = [](void* data) -> unsigned {
      (*static_cast<const std::function<void()>*>(data))();
      return HD_CALLBACK_DONE;
    };
    hd.hdScheduleAsynchronous(call, const_cast<std::function<void()>*>(&body), 1);
    hd.hdStartScheduler();
    stand_in.run(1);
    hd.hdStopScheduler();
  }
  HDerror error() { return hd.hdGetError().errorCode; }
  void TearDown() override {
    hd.hdStopScheduler();
    if (device != HD_INVALID_HANDLE) hd.hdDisableDevice(device);
  }

  const LibHd hd = load_libhd(TOOTHPREP_STAND_IN);
  const StandIn& stand_in = StandIn::get();
  HHD device = HD_INVALID_HANDLE;
};

TEST_F(StandInTest, FindsWrongUsesOfFrames) {
  open();
  const double force[3] = {1, 0, 0};
  double position[3];
  hd.hdBeginFrame(device);
  EXPECT_EQ(error(), HD_ILLEGAL_BEGIN);  // outside the servo
  hd.hdSetDoublev(HD_CURRENT_FORCE, force);
  EXPECT_EQ(error(), HD_FRAME_ERROR);
  hd.hdGetDoublev(HD_CURRENT_POSITION, position);
  EXPECT_EQ(error(), HD_FRAME_ERROR);
  in_tick([&] {
    hd.hdEndFrame(device);
    EXPECT_EQ(error(), HD_ILLEGAL_END);
    hd.hdBeginFrame(device);
    EXPECT_EQ(error(), HD_SUCCESS);
    hd.hdBeginFrame(device);
    EXPECT_EQ(error(), HD_ILLEGAL_BEGIN);
    hd.hdEndFrame(device);
    hd.hdBeginFrame(device);  // one frame per tick
    EXPECT_EQ(error(), HD_ILLEGAL_BEGIN);
  });
  EXPECT_EQ(error(), HD_SUCCESS);
  in_tick([&] { hd.hdBeginFrame(device); });
  EXPECT_EQ(error(), HD_FRAME_ERROR);  // never ended
  EXPECT_EQ(stand_in.misuses(), 7);
  EXPECT_STREQ(stand_in.first_misuse(), "hdBeginFrame outside the servo");
}

TEST_F(StandInTest, FindsWrongTypesParametersAndHandles) {
  open();
  int number = 0;
  HDboolean flag = 0;
  double real[16];
  in_tick([&] {
    hd.hdBeginFrame(device);
    hd.hdGetIntegerv(HD_CURRENT_SAFETY_SWITCH, &number);
    EXPECT_EQ(error(), HD_INVALID_INPUT_TYPE);
    hd.hdGetBooleanv(HD_CURRENT_SAFETY_SWITCH, &flag);
    EXPECT_EQ(error(), HD_SUCCESS);
    hd.hdGetDoublev(HD_CURRENT_BUTTONS, real);
    EXPECT_EQ(error(), HD_INVALID_INPUT_TYPE);
    hd.hdSetIntegerv(HD_CURRENT_FORCE, &number);
    EXPECT_EQ(error(), HD_INVALID_INPUT_TYPE);
    hd.hdGetDoublev(0x9999, real);
    EXPECT_EQ(error(), HD_INVALID_ENUM);
    hd.hdEndFrame(device);
  });
  hd.hdGetDoublev(HD_UPDATE_RATE, real);
  EXPECT_EQ(error(), HD_INVALID_INPUT_TYPE);
  hd.hdMakeCurrentDevice(7);
  EXPECT_EQ(error(), HD_BAD_HANDLE);
  hd.hdUnschedule(1);  // what an int makes of a handle of 64 bits
  EXPECT_EQ(error(), HD_INVALID_OPERATION);
  EXPECT_EQ(stand_in.misuses(), 7);
}

TEST_F(StandInTest, FindsForcesBeforeCalibration) {
  open("calibration = \"needs-manual-input\"");
  hd.hdEnable(HD_FORCE_OUTPUT);
  EXPECT_EQ(error(), HD_INVALID_OPERATION);
  in_tick([&] {
    const double force[3] = {1, 0, 0};
    hd.hdBeginFrame(device);
    hd.hdSetDoublev(HD_CURRENT_FORCE, force);
    EXPECT_EQ(error(), HD_FORCE_ERROR);
    hd.hdEndFrame(device);
  });
  EXPECT_EQ(vec(stand_in.state().commanded_force), Vec3::Zero());
  EXPECT_EQ(stand_in.misuses(), 2);
}

TEST_F(StandInTest, TheLatestErrorComesFirst) {
  open();
  hd.hdMakeCurrentDevice(7);
  hd.hdUnschedule(1);
  EXPECT_EQ(error(), HD_INVALID_OPERATION);
  const HDErrorInfo first = hd.hdGetError();
  EXPECT_EQ(first.errorCode, HD_BAD_HANDLE);
  EXPECT_EQ(first.hHD, 7u);
  EXPECT_EQ(error(), HD_SUCCESS);
}

TEST_F(StandInTest, CallbacksRunByPriority) {
  open();
  std::string order;
  struct Entry {
    std::string* order;
    char name;
  } low{&order, 'l'}, high{&order, 'h'}, middle{&order, 'm'};
  const auto call = [](void* data) -> unsigned {
    const Entry& entry = *static_cast<Entry*>(data);
    *entry.order += entry.name;
    return HD_CALLBACK_CONTINUE;
  };
  const HDSchedulerHandle handle = hd.hdScheduleAsynchronous(call, &low, HD_MIN_SCHEDULER_PRIORITY);
  EXPECT_GT(handle, 0xFFFFFFFFul);
  hd.hdScheduleAsynchronous(call, &high, HD_MAX_SCHEDULER_PRIORITY);
  hd.hdScheduleAsynchronous(call, &middle, HD_DEFAULT_SCHEDULER_PRIORITY);
  hd.hdStartScheduler();
  stand_in.run(1);
  hd.hdUnschedule(handle);
  stand_in.run(1);
  EXPECT_EQ(order, "hmlhm");
}

TEST_F(StandInTest, WithoutClampingTooMuchForceIsAnErrorThatSwitchesForcesOff) {
  open("max_force_n = 2");
  hd.hdEnable(HD_FORCE_OUTPUT);
  const double force[3] = {0, 3, 0};
  const auto frame = [&] {
    hd.hdBeginFrame(device);
    hd.hdSetDoublev(HD_CURRENT_FORCE, force);
    hd.hdEndFrame(device);
  };
  in_tick(frame);
  EXPECT_EQ(vec(stand_in.state().commanded_force), Vec3(0, 2, 0));
  EXPECT_EQ(vec(stand_in.state().motor_force), Vec3::Zero());  // the servo has stopped
  hd.hdDisable(HD_MAX_FORCE_CLAMPING);
  in_tick(frame);
  EXPECT_EQ(error(), HD_EXCEEDED_MAX_FORCE);
  EXPECT_FALSE(hd.hdIsEnabled(HD_FORCE_OUTPUT));
}

TEST_F(StandInTest, ClipsAndMakesNoiseAsTold) {
  // Motors that give 1 N of the 3 N promised, a hand of 0.3 N/mm: the handle goes 1/0.3 mm.
  stand_in.set_up(
      "stepped = true\nmotor_limit_n = 1\nfriction_n = 0\nencoder_count_mm = 0\n"
      "[hand]\nmotion = \"rest\"\n[disturbances]\nencoder_noise_mm = 0.05");
  OpenHapticsSettings s;
  s.library = TOOTHPREP_STAND_IN;
  s.ramp = 0;
  s.zero_force_wait = 0;
  const auto opened = open_openhaptics(s);
  Recorder client(Vec3(3, 0, 0));
  opened->start(client);
  stand_in.run(5000);
  opened->stop();
  EXPECT_NEAR(vec(stand_in.state().true_position).x(), 1 / 0.3, 0.01);
  double squares = 0;
  for (const DeviceReading& r : client.readings)
    squares += r.hand.position.y() * r.hand.position.y();
  const double n = static_cast<double>(client.readings.size());
  EXPECT_NEAR(std::sqrt(squares / n), 0.05, 5 * 0.05 / std::sqrt(2 * n));
}

class StandInEnvironment : public ::testing::Test {
 protected:
  // What the environment says counts until the library is configured otherwise, so: a process.
  template <class Body>
  void in_a_process(Body body, const char* expected) {
    ::testing::FLAGS_gtest_death_test_style = "threadsafe";
    EXPECT_EXIT(
        {
          body();
          std::exit(0);
        },
        ::testing::ExitedWithCode(0), expected);
  }
  std::string file(const std::string& name, const std::string& text) const {
    const std::string path = ::testing::TempDir() + name;
    std::ofstream(path) << text;
    return path;
  }
};

TEST_F(StandInEnvironment, AHandFollowsTheCsvPathOfTheEnvironment) {
  const std::string path =
      file("hand.csv", "time_s,x_mm,y_mm,z_mm,buttons\n0,0,0,0,0\n0.05,0,-2,0,1\n1,0,-2,0,1\n");
  in_a_process(
      [&] {
        setenv("TOOTHPREP_LIBHD", TOOTHPREP_STAND_IN, 1);
        setenv("TOOTHPREP_STANDIN_PATH", path.c_str(), 1);
        setenv("TOOTHPREP_STANDIN_SET", "stepped = true\nfriction_n = 0", 1);
        const auto device = open_openhaptics();
        Recorder client;
        device->start(client);
        StandIn::get().run(800);
        device->stop();
        const DevicePose& hand = client.readings.back().hand;
        std::fprintf(stderr, "at %.2f mm, button %u then %u\n", hand.position.y(),
                     client.readings.front().hand.buttons, hand.buttons);
      },
      "at -2.0[01] mm, button 0 then 1");
}

TEST_F(StandInEnvironment, ABadSettingIsToldThroughTheInterface) {
  const std::string settings = file("settings.toml", "max_forze_n = 3\n");
  in_a_process(
      [&] {
        setenv("TOOTHPREP_LIBHD", TOOTHPREP_STAND_IN, 1);
        setenv("TOOTHPREP_STANDIN", settings.c_str(), 1);
        try {
          open_openhaptics();
        } catch (const Error& e) {
          std::fprintf(stderr, "%s\n", e.what());
        }
      },
      "did not open the default device: stand-in: .*settings.toml: max_forze_n: unknown key on "
      "line 1; did you mean 'max_force_n'");
}

}  // namespace
}  // namespace toothprep::testing
