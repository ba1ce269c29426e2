#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/strict_toml.h"
#include "toothprep/tools/rig_check/rig_limits.h"
#include "toothprep/tools/rig_check/rig_report.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;

std::string shipped() {
  return read_small_text(std::string(TOOTHPREP_SOURCE_DIR) + "/data/rig/limits.toml");
}
std::string changed(const std::string& from, const std::string& to) {
  std::string text = shipped();
  const std::size_t at = text.find(from);
  if (at == std::string::npos) throw std::runtime_error("not in the file: " + from);
  return text.replace(at, from.size(), to);
}
std::string error_of(const std::string& text) {
  try {
    parse_rig_limits(text, "limits.toml");
  } catch (const InputError& e) {
    return e.what();
  }
  return "no error";
}

TEST(RigLimits, TheShippedFileReadsAndItsMethodIsTheDefault) {
  const RigLimits limits = parse_rig_limits(shipped(), "limits.toml");
  EXPECT_EQ(limits.devices.size(), 3u);
  EXPECT_GE(limits.limits.size(), 20u);
  const RigMethod defaults;
  EXPECT_EQ(limits.method.rest_window_s, defaults.rest_window_s);
  EXPECT_EQ(limits.method.hand_damping, defaults.hand_damping);
  EXPECT_EQ(limits.method.thermal_time_constant_s, defaults.thermal_time_constant_s);
  EXPECT_EQ(limits.method.vibration_factor, defaults.vibration_factor);
  for (const auto& [figure, limit] : limits.limits) EXPECT_FALSE(limit.why.empty()) << figure;
}

TEST(RigLimits, DevicesAreFoundByPartsOfTheModel) {
  const RigLimits limits = parse_rig_limits(shipped(), "limits.toml");
  const auto name = [&](const std::string& model) {
    const DeviceTraits* const device = find_device(limits, model);
    return device ? device->name : "none";
  };
  EXPECT_EQ(name("PHANTOM Desktop"), "Phantom Desktop");
  EXPECT_EQ(name("simulated Phantom Desktop"), "Phantom Desktop");
  EXPECT_EQ(name("PHANTOM Omni"), "Phantom Omni / Touch");
  EXPECT_EQ(name("Touch"), "Phantom Omni / Touch");
  EXPECT_EQ(name("Touch X"), "Phantom Desktop");
  EXPECT_EQ(name("PHANTOM Premium 1.5A"), "Phantom Premium 1.5");
  EXPECT_EQ(name("omega.3"), "none");
  EXPECT_EQ(name(""), "none");
}

TEST(RigLimits, MistakesAreNamed) {
  EXPECT_THAT(error_of(changed("servo_late_share =", "servo_late_shar =")),
              HasSubstr("did you mean 'servo_late_share'"));
  EXPECT_THAT(error_of(changed("rest_window_s = 0.5", "rest_windows_s = 0.5")),
              HasSubstr("method.rest_window_s: is missing"));
  EXPECT_THAT(error_of(changed("rest_window_s = 0.5", "rest_window_s = 0")), HasSubstr("above 0"));
  EXPECT_THAT(error_of(changed("delay_ticks = 0", "delay_ticks = -1")), HasSubstr("0 to 100"));
  EXPECT_THAT(error_of(changed("friction_n = 0.06", "friction_n = nan")),
              HasSubstr("device[0].friction_n"));
  EXPECT_THAT(error_of(changed("max = 1.0, why = \"above 1", "why = \"above 1")),
              HasSubstr("limits.thermal_load.max: is missing"));
  EXPECT_THAT(error_of(changed("min = 0.99", "min = 1.99")), HasSubstr("must not be above max"));
  EXPECT_THAT(error_of(changed("min = 0.99", "min = inf")), HasSubstr("must be finite"));
  EXPECT_THAT(error_of(changed("{ max = 200.0, why = ", "{ max = 200.0, way = ")),
              HasSubstr("step_cost_p999_us.why"));
  EXPECT_THAT(error_of(changed("models = \"Premium\"", "models = \"Premium, \"")),
              HasSubstr("commas"));
  EXPECT_THAT(error_of("[method]"), HasSubstr("late_periods"));
  EXPECT_THAT(error_of(""), HasSubstr("method"));
  EXPECT_THAT(error_of(shipped() + "\n[other]\n"), HasSubstr("other"));
}

TEST(RigCatalogue, NoKeyTwiceAndEachSaysWhatItMeans) {
  std::map<std::string, int> keys;
  for (const RigFigure& f : rig_catalogue()) {
    EXPECT_EQ(++keys[f.key], 1) << f.key;
    EXPECT_STRNE(f.meaning, "");
    EXPECT_STRNE(f.section, "");
  }
}

}  // namespace
}  // namespace toothprep
