#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;

class CsvTrajectory : public ::testing::Test {
 protected:
  void TearDown() override { std::remove(path_.c_str()); }
  Trajectory read(const std::string& text) {
    std::ofstream(path_, std::ios::binary) << text;
    return read_csv_trajectory(path_);
  }
  std::string error(const std::string& text) {
    try {
      read(text);
    } catch (const InputError& e) {
      return e.what();
    }
    return "no error";
  }
  std::string path_ = ::testing::TempDir() + "toothprep_csv_" + std::to_string(getpid()) + ".csv";
};

TEST_F(CsvTrajectory, FourColumnsAreEnough) {
  const Trajectory t = read("time_s,x_mm,y_mm,z_mm\n0,1,2,3\n0.001,1.5,-2e-3,3\n");
  ASSERT_EQ(t.samples.size(), 2u);
  EXPECT_EQ(t.samples[1].time, 0.001);
  EXPECT_EQ(t.samples[1].pose.position, Vec3(1.5, -0.002, 3));
  EXPECT_EQ(t.samples[1].pose.orientation.coeffs(), Quat::Identity().coeffs());
  EXPECT_EQ(t.samples[1].buttons, kPedalButton);  // absent: always on
  EXPECT_TRUE(t.measured_force.empty());
}

TEST_F(CsvTrajectory, AllColumnsInAnyOrderWithSpacesMarkAndCarriageReturns) {
  const Trajectory t = read(
      "\xef\xbb\xbftime_s, x_mm,y_mm,z_mm,qw,qx,qy,qz,fx_N,fy_N,fz_N,buttons\r\n"
      "0,0,0,0,0.5,0.5,0.5,0.5,1,2,3,0\r\n"
      " 1 ,0,0,0,1,0,0,0, -1 ,-2,-3,5\r\n"
      "\r\n\r\n");
  ASSERT_EQ(t.samples.size(), 2u);
  EXPECT_EQ(t.samples[0].pose.orientation.coeffs(), Quat(0.5, 0.5, 0.5, 0.5).coeffs());
  EXPECT_EQ(t.samples[1].pose.orientation.w(), 1);
  EXPECT_EQ(t.samples[0].buttons, 0u);
  EXPECT_EQ(t.samples[1].buttons, 5u);
  ASSERT_EQ(t.measured_force.size(), 2u);
  EXPECT_EQ(t.measured_force[1], Vec3(-1, -2, -3));
}

TEST_F(CsvTrajectory, AQuaternionSlightlyOffIsNormalisedOneFarOffRefused) {
  const std::string header = "time_s,x_mm,y_mm,z_mm,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n";
  const Trajectory t = read(header + "1,0,0,0,0,0,0,1.0005\n");
  EXPECT_EQ(t.samples[1].pose.orientation.w(), 1.0);
  EXPECT_THAT(error(header + "1,0,0,0,0,0,0,1.01\n"), HasSubstr("line 3"));
  EXPECT_THAT(error(header + "1,0,0,0,0,0,0,0\n"), HasSubstr("unit length"));
}

TEST_F(CsvTrajectory, ShortestDecimalsAreReadBackBitForBit) {
  const Trajectory t =
      read("time_s,x_mm,y_mm,z_mm\n0,0.1,1e-300,5e-324\n1,1.7976931348623157e308,0,-0\n");
  EXPECT_EQ(t.samples[0].pose.position, Vec3(0.1, 1e-300, 5e-324));
  EXPECT_EQ(t.samples[1].pose.position.x(), 1.7976931348623157e308);
}

TEST_F(CsvTrajectory, DamageIsNamedByLineAndColumn) {
  const std::string h = "time_s,x_mm,y_mm,z_mm\n";
  const std::string one = h + "0,0,0,0\n";
  const std::vector<std::pair<std::string, std::string>> table = {
      {"", "is empty"},
      {h, "fewer than two samples"},
      {one, "fewer than two samples"},
      {"0,1,2,3\n1,1,2,3\n", "unknown column '0'"},
      {"time,x_mm,y_mm,z_mm\n", "did you mean 'time_s'"},
      {"time_s,x,y_mm,z_mm\n", "did you mean 'x_mm'"},
      {"time_s,x_m,y_mm,z_mm\n", "line 1, column 2: unknown column 'x_m'"},
      {"time_s,x_mm,y_mm\n", "column 'z_mm' is missing"},
      {"time_s,x_mm,y_mm,z_mm,z_mm\n", "stands twice"},
      {"time_s,x_mm,y_mm,z_mm,qx,qy,qz\n", "column 'qw' is missing"},
      {"time_s,x_mm,y_mm,z_mm,fx_N\n", "column 'fy_N' is missing"},
      {"time_s;x_mm;y_mm;z_mm\n", "unknown column"},
      {one + "1,0,0\n", "line 3: has 3 columns where the header has 4"},
      {one + "1,0,0,0,0\n", "line 3: has 5 columns"},
      {one + "1,0,0,\n", "line 3, column z_mm: '' is not a finite number"},
      {one + "1,0,abc,0\n", "line 3, column y_mm: 'abc'"},
      {one + "1,0,0x10,0\n", "column y_mm"},
      {one + "1,0,1.5mm,0\n", "column y_mm"},
      {one + "1,0,nan,0\n", "column y_mm"},
      {one + "1,0,inf,0\n", "column y_mm"},
      {one + "1,0,1e999,0\n", "column y_mm"},
      {one + "# comment\n", "line 3"},
      {one + "0,0,0,0\n", "line 3, column time_s: time does not increase"},
      {one + "-1,0,0,0\n", "time does not increase"},
      {one + "\n1,0,0,0\n", "line 4: follows a blank line"},
      {one + std::string(100000, '1'), "longer than 64 kB"},
      {std::string(100000, '\0'), "longer than 64 kB"},
      {std::string("\x89HDF\r\n\x1a\n", 8), "unknown column"},
      {"time_s,x_mm,y_mm,z_mm,buttons\n0,0,0,0,0.5\n", "column buttons"},
      {"time_s,x_mm,y_mm,z_mm,buttons\n0,0,0,0,-1\n", "column buttons"}};
  for (const auto& [text, part] : table) {
    EXPECT_THAT(error(text), HasSubstr(part)) << text.substr(0, 100);
    EXPECT_THAT(error(text), HasSubstr(path_ + ": "));
  }
  EXPECT_THROW(static_cast<void>(read_csv_trajectory("no/such.csv")), InputError);
  EXPECT_THROW(static_cast<void>(read_csv_trajectory(::testing::TempDir())), InputError);
}

}  // namespace
}  // namespace toothprep
