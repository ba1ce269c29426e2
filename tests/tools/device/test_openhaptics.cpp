// What is particular to the vendor's interface: finding the library, opening, asking, refusing.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "rig.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/device/libhd.h"

namespace toothprep::testing {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

class OpenHaptics : public ::testing::Test {
 protected:
  std::unique_ptr<HapticDevice> open(const std::string& toml, OpenHapticsSettings settings = {}) {
    stand_in.set_up("stepped = true\n" + toml);
    settings.library = TOOTHPREP_STAND_IN;
    settings.ramp = 0;
    settings.zero_force_wait = 0;  // stepped: no tick to wait for
    return open_openhaptics(settings);
  }
  void TearDown() override {
    EXPECT_EQ(stand_in.misuses(), 0) << stand_in.first_misuse();
    unsetenv("TOOTHPREP_LIBHD");
  }
  const StandIn& stand_in = StandIn::get();
};

TEST_F(OpenHaptics, AMissingLibrarySaysWhatWasTriedAndWhatToInstall) {
  EXPECT_THAT([] { hdapi::load_libhd("/nowhere/libHD.so"); },
              ThrowsMessage<Error>(AllOf(HasSubstr("tried /nowhere/libHD.so ("),
                                         HasSubstr("install the device's driver"),
                                         HasSubstr("TOOTHPREP_LIBHD"))));
  // A library that the user named is the one, or none.
  setenv("TOOTHPREP_LIBHD", "/elsewhere/libHD.so", 1);
  EXPECT_THAT([] { open_openhaptics(); },
              ThrowsMessage<Error>(HasSubstr("tried /elsewhere/libHD.so (")));
  setenv("TOOTHPREP_LIBHD", TOOTHPREP_STAND_IN, 1);
  EXPECT_EQ(hdapi::load_libhd().path, TOOTHPREP_STAND_IN);
}

TEST_F(OpenHaptics, ALibraryThatIsSomethingElseIsNamedWithTheMissingFunction) {
  EXPECT_THAT([] { hdapi::load_libhd("libm.so.6"); },
              ThrowsMessage<Error>(
                  AllOf(HasSubstr("libm.so.6 has no function hdInitDevice"), HasSubstr("libHD"))));
}

TEST_F(OpenHaptics, ADeviceThatIsNotThereIsAClearError) {
  EXPECT_THAT(
      [&] { open("present = false"); },
      ThrowsMessage<Error>(AllOf(HasSubstr("did not open the default device"),
                                 HasSubstr("device fault (0x0300)"), HasSubstr("dialout"))));
  OpenHapticsSettings named;
  named.name = "left";
  EXPECT_THAT([&] { open("", named); }, ThrowsMessage<Error>(HasSubstr("the device 'left'")));
  OpenHapticsSettings mirrored;
  mirrored.mirror_name = "right";
  EXPECT_THAT([&] { open("", mirrored); }, ThrowsMessage<Error>(HasSubstr("the device 'right'")));
  open("");  // and the first device was closed again
}

TEST_F(OpenHaptics, OpensADeviceByItsName) {
  OpenHapticsSettings named;
  named.name = "left";
  const auto device = open("name = \"right\"\nmirror_name = \"left\"", named);
  EXPECT_EQ(device->identity().name, "left");
  EXPECT_EQ(device->identity().serial, "0002");
  EXPECT_EQ(device->identity().firmware, "1.5");
}

TEST_F(OpenHaptics, TheSameDeviceCannotBeBothHands) {
  OpenHapticsSettings twice;
  twice.mirror_name = "default";
  EXPECT_THAT([&] { open("", twice); }, ThrowsMessage<Error>(HasSubstr("already open")));
}

TEST_F(OpenHaptics, OneAtATime) {
  const auto device = open("");
  EXPECT_THAT(
      [] {
        OpenHapticsSettings s;
        s.library = TOOTHPREP_STAND_IN;
        open_openhaptics(s);
      },
      ThrowsMessage<Error>(HasSubstr("give both names at once")));
}

TEST_F(OpenHaptics, ForcesAreOnOnlyWhileItRuns) {
  auto device = open("");
  Recorder client;
  EXPECT_EQ(stand_in.state().force_output, 0);
  device->start(client);
  EXPECT_EQ(stand_in.state().force_output, 1);
  device->stop();
  EXPECT_EQ(stand_in.state().force_output, 0);
  device.reset();
  EXPECT_EQ(stand_in.state().force_output, 0);
}

TEST_F(OpenHaptics, WithoutCalibrationItDoesNotStartAndSaysWhatToDo) {
  const std::pair<const char*, const char*> cases[] = {{"inkwell", "into its inkwell"},
                                                       {"auto", "through the whole workspace"},
                                                       {"encoder-reset", "reset position"}};
  for (const auto& [style, advice] : cases) {
    const auto device = open("calibration = \"needs-manual-input\"\ncalibration_style = \"" +
                             std::string(style) + "\"");
    EXPECT_EQ(device->calibration(), Calibration::kNeedsManualInput);
    Recorder client(Vec3(1, 0, 0));
    EXPECT_THAT(
        [&] { device->start(client); },
        ThrowsMessage<Error>(AllOf(HasSubstr("default is not calibrated"), HasSubstr(advice))));
    EXPECT_EQ(stand_in.run(10), 0);
    EXPECT_EQ(stand_in.state().force_output, 0);
    EXPECT_TRUE(client.readings.empty());
  }
}

TEST_F(OpenHaptics, AnUpdateOfTheCalibrationIsTakenExceptAResetOfTheEncoders) {
  for (const char* style : {"inkwell", "auto"}) {
    const auto device =
        open("calibration = \"needs-update\"\ncalibration_style = \"" + std::string(style) + "\"");
    EXPECT_EQ(device->calibration(), Calibration::kOk);
  }
  const auto device = open("calibration = \"needs-update\"\ncalibration_style = \"encoder-reset\"");
  EXPECT_EQ(device->calibration(), Calibration::kNeedsUpdate);
  Recorder client;
  EXPECT_THROW(device->start(client), Error);
}

TEST_F(OpenHaptics, AServoThatDoesNotStartIsAnErrorWithForcesOff) {
  const auto device = open("start_fails = true");
  Recorder client;
  EXPECT_THAT([&] { device->start(client); },
              ThrowsMessage<Error>(
                  AllOf(HasSubstr("timer error (0x0304)"), HasSubstr("close other programs"))));
  EXPECT_EQ(stand_in.state().force_output, 0);
}

TEST_F(OpenHaptics, AnUnpluggedDeviceStaysLost) {
  const auto device = open("[[fault]]\nwhat = \"unplugged\"\nat_tick = 7");
  Recorder client(Vec3(1, 0, 0));
  device->start(client);
  stand_in.run(20);
  EXPECT_EQ(client.readings.size(), 7u);
  const DeviceStatus status = device->status();
  EXPECT_EQ(status.state, ServoState::kFaulted);
  EXPECT_EQ(status.last_fault, DeviceFault::kUnplugged);
  EXPECT_EQ(status.driver_code, hdapi::HD_BAD_HANDLE);
  EXPECT_EQ(status.force, Vec3::Zero());
  EXPECT_EQ(vec(stand_in.state().motor_force), Vec3::Zero());
  device->stop();
  EXPECT_THAT([&] { device->start(client); }, ThrowsMessage<Error>(HasSubstr("open it again")));
}

TEST_F(OpenHaptics, ALostMirrorHandStopsTheGrindingHandToo) {
  OpenHapticsSettings two;
  two.mirror_name = "mirror";
  const auto device =
      open("[[fault]]\nwhat = \"comm-error\"\nat_tick = 7\ndevice = 1\nticks = 1000", two);
  Recorder client(Vec3(1, 0, 0));
  device->start(client);
  stand_in.run(20);
  EXPECT_EQ(client.readings.size(), 7u);
  EXPECT_EQ(device->status().last_fault, DeviceFault::kCommunication);
  EXPECT_EQ(vec(stand_in.state(0).commanded_force), Vec3::Zero());
  EXPECT_EQ(stand_in.state(1).force_output, 0);
}

TEST_F(OpenHaptics, AnErrorAtTheEndOfATickIsToldAtOnce) {
  // There may be no next tick to report it in.
  const auto device = open("[[fault]]\nwhat = \"force-error\"\nat_tick = 5");
  Recorder client(Vec3(1, 0, 0));
  device->start(client);
  stand_in.run(6);
  EXPECT_EQ(device->status().state, ServoState::kFaulted);
  EXPECT_EQ(device->status().last_fault, DeviceFault::kDevice);
  EXPECT_EQ(device->status().driver_code, hdapi::HD_FORCE_ERROR);
  stand_in.run(1);
  EXPECT_EQ(vec(stand_in.state().commanded_force), Vec3::Zero());
}

TEST_F(OpenHaptics, ADriverThatSwitchesForcesOffIsToldToAllowThemAgain) {
  const auto device = open("[[fault]]\nwhat = \"force-exceeded\"\nat_tick = 5");
  Recorder client(Vec3(1, 0, 0));
  device->start(client);
  stand_in.run(6);
  EXPECT_EQ(stand_in.state().force_output, 0);
  stand_in.run(2);
  EXPECT_EQ(stand_in.state().force_output, 1);
  EXPECT_EQ(vec(stand_in.state().motor_force), client.force);
  EXPECT_EQ(device->status().driver_code, hdapi::HD_EXCEEDED_MAX_FORCE);
}

TEST_F(OpenHaptics, WhatADeviceLacksIsNotAskedForAgain) {
  // A Touch has no safety switch; a device without an encoder gimbal has no orientation.
  const auto device = open("has_safety_switch = false\nhas_orientation = false");
  EXPECT_FALSE(device->limits().has_orientation);
  Recorder client(Vec3(1, 0, 0));
  device->start(client);
  stand_in.run(10);
  ASSERT_EQ(client.readings.size(), 10u);
  EXPECT_EQ(device->status().faults, 0);
  EXPECT_FALSE(client.readings.back().hand.safety_switch.has_value());
  EXPECT_EQ(client.readings.back().hand.orientation.coeffs(), Quat::Identity().coeffs());
  EXPECT_EQ(vec(stand_in.state().motor_force), client.force);
}

TEST_F(OpenHaptics, TheSafetySwitchIsReadAsTheBooleanThatItIs) {
  const auto device = open("");
  Recorder client;
  device->start(client);
  stand_in.run(2);
  EXPECT_EQ(client.readings.back().hand.safety_switch, std::optional<bool>(true));
}

TEST_F(OpenHaptics, ARateThatIsGivenAsADoubleIsRead) {
  const auto device = open("rate_as_double = true\nrate_hz = 500");
  EXPECT_DOUBLE_EQ(device->limits().rate, 500);
  EXPECT_TRUE(device->limits().notes.empty());
}

TEST_F(OpenHaptics, TheRateCanBeChosenAmongThoseThatTheDriverKnows) {
  OpenHapticsSettings s;
  s.rate = 500;
  EXPECT_DOUBLE_EQ(open("", s)->limits().rate, 500);
  s.rate = 333;
  EXPECT_THAT([&] { open("", s); }, ThrowsMessage<Error>(HasSubstr("does not run at 333 Hz")));
}

TEST_F(OpenHaptics, LimitsThatAreNotToldOrAbsurdAreAssumedAndSaid) {
  const auto silent = open("refused = [0x2551, 0x2600, 0x2602, 0x2603, 0x2604, 0x2609, 0x2553]");
  const DeviceLimits& limits = silent->limits();
  EXPECT_DOUBLE_EQ(limits.rate, 1000);
  EXPECT_DOUBLE_EQ(limits.max_force, 3.3);  // an Omni's, the weakest of the family
  EXPECT_DOUBLE_EQ(limits.max_continuous_force, 0.88);
  EXPECT_DOUBLE_EQ(limits.max_stiffness, 0.4);
  EXPECT_DOUBLE_EQ(limits.max_damping, 4e-3);
  EXPECT_DOUBLE_EQ(limits.workspace.max().z(), 35);
  EXPECT_EQ(limits.notes.size(), 7u);
}

TEST_F(OpenHaptics, AbsurdLimitsAreAssumedAndSaid) {
  const auto absurd = open(
      "max_force_n = 1e6\ncontinuous_force_n = 50\nmax_damping_n_s_per_mm = -1\n"
      "max_stiffness_n_per_mm = 0");
  EXPECT_DOUBLE_EQ(absurd->limits().max_force, 3.3);
  EXPECT_DOUBLE_EQ(absurd->limits().max_continuous_force, 0.88);
  EXPECT_DOUBLE_EQ(absurd->limits().max_damping, 4e-3);
  EXPECT_DOUBLE_EQ(absurd->limits().max_stiffness, 0.4);
  ASSERT_EQ(absurd->limits().notes.size(), 4u);
  EXPECT_EQ(absurd->limits().notes[0], "maximum force: assumed 3.3 N, the device says 1e+06");
}

TEST_F(OpenHaptics, ASafeguardThatTheDriverLacksIsNoted) {
  const auto device = open("refused = [0x4003]");
  Recorder client;
  device->start(client);
  ASSERT_EQ(device->limits().notes.size(), 1u);
  EXPECT_THAT(device->limits().notes[0], HasSubstr("software force limit"));
  device->stop();
  device->start(client);
  EXPECT_EQ(device->limits().notes.size(), 1u);
}

}  // namespace
}  // namespace toothprep::testing
