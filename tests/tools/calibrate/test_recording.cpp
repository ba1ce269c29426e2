#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>

#include "experiment.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/trace.h"

namespace toothprep::testing {
namespace {

using ::testing::HasSubstr;

std::string refusal(const std::function<void()>& act) {
  try {
    act();
  } catch (const InputError& e) {
    return e.what();
  }
  return "(accepted)";
}

MeasuredRecording realistic() {
  SensorOptions s;
  s.noise = 0.05;
  return recorded(mixed_feed(), measured_by(s, true_force(mixed_basis()), mixed_basis().step));
}

TEST(Recording, RealisticIsAccepted) {
  MeasuredRecording r = realistic();
  EXPECT_EQ(refusal([&] { check_recording(r); }), "(accepted)");
}

TEST(Recording, LengthsMustAgree) {
  MeasuredRecording r = realistic();
  r.motion.measured_force.pop_back();
  EXPECT_THAT(refusal([&] { check_recording(r); }), HasSubstr("of the motion"));
}

TEST(Recording, NanIsRefused) {
  MeasuredRecording r = realistic();
  r.motion.measured_force[100].y() = std::nan("");
  EXPECT_THAT(refusal([&] { check_recording(r); }), HasSubstr("sample 100: is not finite"));
}

TEST(Recording, SaturatedSensorIsRefusedOrItsRangeTaken) {
  MeasuredRecording r = realistic();
  double most = 0;
  for (const Vec3& f : r.motion.measured_force) most = std::max(most, f.y());
  const double limit = 0.5 * most;
  for (Vec3& f : r.motion.measured_force) f = f.cwiseMin(limit).cwiseMax(-limit);
  EXPECT_THAT(refusal([&] { check_recording(r); }), HasSubstr("saturated"));
  ForceReading with_range;
  with_range.range = limit;
  check_recording(r, with_range);
  FitOptions o;
  const FitResult fitted = fit({compare(r, mixed_basis(), o.largest_delay, 0, false)}, o);
  expect_truth(fitted, 0.05);
}

TEST(Recording, GramsAreSeenByTheirMagnitude) {
  MeasuredRecording r = realistic();
  for (Vec3& f : r.motion.measured_force) f /= 0.00980665;
  EXPECT_THAT(refusal([&] { check_recording(r); }), HasSubstr("grams"));
  ForceReading stated;
  stated.unit_stated = true;
  EXPECT_EQ(refusal([&] { check_recording(r, stated); }), "(accepted)");
}

TEST(Recording, MissingAndConstantForceAreRefused) {
  MeasuredRecording r = realistic();
  r.motion.measured_force.assign(r.motion.samples.size(), Vec3(1, 2, 3));
  EXPECT_THAT(refusal([&] { check_recording(r); }), HasSubstr("never changes"));
  r.motion.measured_force.clear();
  EXPECT_THAT(refusal([&] { check_recording(r); }), HasSubstr("is missing"));
}

TEST(Recording, OfAnotherToothIsRefused) {
  MeasuredRecording r = realistic();
  check_same_tooth(r, "abc", "tooth.vdb");  // a file that doesn't say
  r.tooth_sha256 = "abc";
  check_same_tooth(r, "abc", "tooth.vdb");
  EXPECT_THAT(refusal([&] { check_same_tooth(r, "abd", "tooth.vdb"); }),
              HasSubstr("another tooth"));
}

TEST(Recording, CsvOfGramForceOnTheToothIsReadInNewtonsOnTheBur) {
  const auto path = std::filesystem::temp_directory_path() /
                    ("toothprep-calibrate-" + std::to_string(::getpid()) + ".csv");
  {
    std::ofstream out(path);
    out << "time_s,x_mm,y_mm,z_mm,fx_N,fy_N,fz_N\n";
    for (int i = 0; i < 50; ++i)
      out << i * 0.001 << ",0," << -i * 0.001 << ",0," << i << ",0," << -2 * i << "\n";
  }
  ForceReading reading;
  reading.newton_per_unit = 0.00980665;
  reading.on_tooth = true;
  const MeasuredRecording r = read_recording(path.string(), reading);
  EXPECT_NEAR(r.motion.measured_force[10].x(), -0.0980665, 1e-12);
  EXPECT_NEAR(r.motion.measured_force[10].z(), 0.196133, 1e-12);
  std::filesystem::remove(path);
}

}  // namespace
}  // namespace toothprep::testing
