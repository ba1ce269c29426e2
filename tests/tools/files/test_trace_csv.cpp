#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>

#include "synthetic_trace.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/trace.h"

namespace toothprep {
namespace {

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> fields;
  std::istringstream in(line);
  for (std::string field; std::getline(in, field, ',');) fields.push_back(field);
  return fields;
}

TEST(TraceCsv, EveryColumnReadsBackAsTheSameDoubleUnderItsNameAndUnit) {
  const std::string path =
      ::testing::TempDir() + "toothprep_csv_" + std::to_string(getpid()) + ".csv";
  Trace trace = synthetic_trace(300);
  trace.measured_force.assign(300, Vec3(0.1, 0.2, 0.3));
  write_trace_csv(trace, path);
  std::ifstream in(path);
  std::string line;
  std::getline(in, line);
  const std::vector<std::string> header = split(line);
  for (const StepRecord& row : trace.rows) {
    ASSERT_TRUE(std::getline(in, line));
    const std::vector<std::string> fields = split(line);
    ASSERT_EQ(fields.size(), header.size());
    std::map<std::string, double> value;
    for (std::size_t i = 0; i < header.size(); ++i)
      value[header[i]] = std::strtod(fields[i].c_str(), nullptr);
    ASSERT_EQ(value.size(), header.size());  // no name stands twice
    ASSERT_EQ(value.at("time_s"), row.handle.time);
    ASSERT_EQ(value.at("handle_y_mm"), row.handle.pose.position.y());
    ASSERT_EQ(value.at("handle_qw"), row.handle.pose.orientation.w());
    ASSERT_EQ(value.at("handle_qx"), row.handle.pose.orientation.x());
    ASSERT_EQ(value.at("handle_buttons"), row.handle.buttons);
    ASSERT_EQ(value.at("bur_z_mm"), row.bur.position.z());
    ASSERT_EQ(value.at("bur_qz"), row.bur.orientation.z());
    ASSERT_EQ(value.at("bur_velocity_y_mm_s"), row.bur_velocity.y());
    ASSERT_EQ(value.at("force_grinding_x_N"), row.grinding_force.x());
    ASSERT_EQ(value.at("force_device_x_N"), row.device_force.x());
    ASSERT_EQ(value.at("force_device_z_N"), row.device_force.z());
    ASSERT_EQ(value.at("force_measured_z_N"), 0.3);
    ASSERT_EQ(value.at("torque_mNm"), row.torque);
    ASSERT_EQ(value.at("torque_trial_mNm"), row.torque_trial);
    ASSERT_DOUBLE_EQ(value.at("power_W"), row.power / 1000);
    ASSERT_EQ(value.at("rotation_rate_rev_s"), row.rotation_rate);
    ASSERT_EQ(value.at("stalled"), row.stalled);
    ASSERT_EQ(value.at("stalled_fraction"), row.stalled_fraction);
    ASSERT_EQ(value.at("contact_enamel_mm2"), row.contact_area[0]);
    ASSERT_EQ(value.at("contact_other_mm2"), row.contact_area[3]);
    ASSERT_EQ(value.at("contact_shank_mm2"), row.shank_contact_area);
    ASSERT_EQ(value.at("removed_dentin_mm3"), row.removed_volume[1]);
    ASSERT_EQ(value.at("removed_pulp_mm3"), row.removed_volume[2]);
  }
  EXPECT_FALSE(std::getline(in, line));
  std::remove(path.c_str());
}

TEST(TraceCsv, AFullOrAbsentPlaceIsAnError) {
  EXPECT_THROW(write_trace_csv(synthetic_trace(3), "no/such/folder/t.csv"), Error);
  if (access("/dev/full", W_OK) == 0) {
    EXPECT_THROW(write_trace_csv(synthetic_trace(3), "/dev/full"), Error);
  }
}

}  // namespace
}  // namespace toothprep
