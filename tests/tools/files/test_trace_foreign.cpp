// Files across the border: what Python reads of ours, and what we read of Python's. Needs
// /usr/bin/python3 with h5py (and matplotlib for plot-trace), which scripts/test installs.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "synthetic_trace.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/trace.h"

namespace toothprep {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class ForeignPrograms : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(::testing::TempDir()) /
              ("toothprep_foreign_" + std::to_string(getpid()) + "_" +
               ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    write_trace(synthetic_trace(2000), at("trace.h5"));
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string at(const std::string& name) const { return (folder_ / name).string(); }

  // Runs /usr/bin/python3 SCRIPT ARGUMENTS; gives its exit status and collects its output.
  int python(const std::string& script, const std::string& arguments) {
    const std::string command = "/usr/bin/python3 '" TOOTHPREP_SOURCE_DIR "/" + script + "' " +
                                arguments + " > '" + at("output.txt") + "' 2>&1";
    const int status = std::system(command.c_str());
    std::ostringstream text;
    text << std::ifstream(at("output.txt")).rdbuf();
    output_ = text.str();
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  std::string refusal(const std::string& path, bool as_trace) {
    try {
      if (as_trace)
        static_cast<void>(read_trace(path));
      else
        static_cast<void>(read_h5_trajectory(path));
    } catch (const InputError& e) {
      return e.what();
    }
    return "no error";
  }
  fs::path folder_;
  std::string output_;
};

TEST_F(ForeignPrograms, H5pyFindsEveryDatasetWithItsUnit) {
  EXPECT_EQ(python("tests/tools/files/check_trace.py", "'" + at("trace.h5") + "'"), 0) << output_;
}

TEST_F(ForeignPrograms, FilesOfH5pyAreReadAndDamagedOnesRefusedByName) {
  ASSERT_EQ(python("tests/tools/files/make_foreign_files.py",
                   "'" + at("trace.h5") + "' '" + folder_.string() + "'"),
            0)
      << output_;

  const Trajectory minimal = read_h5_trajectory(at("good_minimal.h5"));
  ASSERT_EQ(minimal.samples.size(), 50u);
  EXPECT_EQ(minimal.samples[49].pose.position, Vec3(1, 1, 1));
  EXPECT_EQ(minimal.samples[49].pose.orientation.w(), 1);
  EXPECT_EQ(minimal.samples[49].buttons, kPedalButton);
  EXPECT_TRUE(minimal.measured_force.empty());

  const Trajectory matlab = read_h5_trajectory(at("good_matlab.h5"));
  ASSERT_EQ(matlab.samples.size(), 50u);
  EXPECT_EQ(matlab.samples[1].time, 0.001);
  EXPECT_EQ(matlab.samples[1].pose.orientation.z(), 1.0);  // normalised
  EXPECT_EQ(matlab.samples[1].buttons, 0u);
  EXPECT_EQ(matlab.samples[2].buttons, 1u);
  ASSERT_EQ(matlab.measured_force.size(), 50u);
  EXPECT_EQ(matlab.measured_force[2], Vec3(6, 7, 8));

  const Trajectory integers = read_h5_trajectory(at("good_bigendian.h5"));
  EXPECT_EQ(integers.samples[3].time, 0.003);
  EXPECT_EQ(integers.samples[3].pose.position, Vec3(9, 10, 11));

  const Trace own = read_trace(at("trace.h5")), order = read_trace(at("good_order.h5"));
  const StepRecord &a = own.rows[1900], &b = order.rows[1900];
  EXPECT_EQ(b.removed_volume, (PerTissue<double>{a.removed_volume[0], a.removed_volume[1], 0, 0}));
  EXPECT_EQ(b.contact_area[1], a.contact_area[1]);
  EXPECT_EQ(b.handle.buttons, kPedalButton);

  std::ifstream same(at("same.txt"));
  int ways = 0;
  for (std::string name; std::getline(same, name); ++ways) {
    SCOPED_TRACE(name);
    expect_same_rows(read_trace(at(name)), own);
    expect_same_rows(read_trace(at(name), ReadPolicy::kDirect), own);
    EXPECT_EQ(read_h5_trajectory(at(name)).samples.size(), own.rows.size());
  }
  EXPECT_GT(ways, 10);

  std::ifstream expected(at("expected.txt"));
  int files = 0;
  for (std::string name, reader, part;
       std::getline(expected, name, '\t') && std::getline(expected, reader, '\t') &&
       std::getline(expected, part);
       ++files) {
    EXPECT_THAT(refusal(at(name), reader == "trace"), HasSubstr(part)) << name;
    if (reader == "trajectory") {
      EXPECT_NE(refusal(at(name), true), "no error") << name;  // nor is it a trace
    }
  }
  EXPECT_GT(files, 50);
}

TEST_F(ForeignPrograms, PlotTraceDrawsATraceAndRefusesWhatIsNone) {
  const std::string in = "'" + at("trace.h5") + "' -o '";
  ASSERT_EQ(python("scripts/plot-trace", in + at("t.png") + "'"), 0) << output_;
  std::ifstream png(at("t.png"), std::ios::binary);
  std::string signature(8, '\0');
  png.read(signature.data(), 8);
  EXPECT_EQ(signature, "\x89PNG\r\n\x1a\n");
  EXPECT_GT(fs::file_size(at("t.png")), 20000u);
  ASSERT_EQ(python("scripts/plot-trace", in + at("t.svg") + "'"), 0) << output_;

  EXPECT_EQ(python("scripts/plot-trace", in + at("t.png") + "'"), 1);  // exists already
  EXPECT_THAT(output_, HasSubstr("--force"));
  EXPECT_EQ(python("scripts/plot-trace", "--force " + in + at("t.png") + "'"), 0) << output_;

  std::ofstream(at("text.h5")) << "not a trace";
  for (const std::string bad : {"text.h5", "absent.h5"}) {
    EXPECT_EQ(python("scripts/plot-trace", "'" + at(bad) + "' -o '" + at("bad.png") + "'"), 1);
    EXPECT_THAT(output_, HasSubstr(bad));
    EXPECT_EQ(std::count(output_.begin(), output_.end(), '\n'), 1) << output_;
    EXPECT_FALSE(fs::exists(at("bad.png")));
  }
}

}  // namespace
}  // namespace toothprep
