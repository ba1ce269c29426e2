#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <sstream>

#include "../../support/repetitions.h"
#include "synthetic_trace.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/trace.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;

std::string bytes_of(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

class TraceFile : public ::testing::Test {
 protected:
  void TearDown() override {
    std::remove(path_.c_str());
    std::remove(other_.c_str());
  }
  std::string error_of(const std::string& path) {
    try {
      static_cast<void>(read_trace(path));
    } catch (const InputError& e) {
      return e.what();
    }
    return "no error";
  }
  std::string path_ = ::testing::TempDir() + "toothprep_trace_" + std::to_string(getpid()) + ".h5";
  std::string other_ =
      ::testing::TempDir() + "toothprep_trace2_" + std::to_string(getpid()) + ".h5";
};

TEST_F(TraceFile, EveryFieldComesBackBitForBit) {
  Trace trace = synthetic_trace(20000);  // several chunks, the last one partial
  for (std::size_t i = 0; i < trace.rows.size(); ++i)
    trace.measured_force.push_back(Vec3(std::cos(i), 0.1 * static_cast<double>(i), -1e-9));
  write_trace(trace, path_);
  const Trace back = read_trace(path_);
  expect_same_rows(trace, back);
  EXPECT_EQ(back.measured_force, trace.measured_force);
  EXPECT_EQ(back.parameters_toml, trace.parameters_toml);
  EXPECT_EQ(back.tooth_sha256, trace.tooth_sha256);
  EXPECT_EQ(back.toothprep_version, trace.toothprep_version);
  EXPECT_EQ(back.bur, trace.bur);
  EXPECT_EQ(back.drive, trace.drive);
  EXPECT_EQ(back.engine, trace.engine);
  EXPECT_EQ(back.audit.torque_work_mj, trace.audit.torque_work_mj);
  EXPECT_EQ(back.audit.removed_energy_mj, trace.audit.removed_energy_mj);
  EXPECT_EQ(back.audit.energy_ratio, trace.audit.energy_ratio);
  EXPECT_EQ(back.initial_overlap_mm3, trace.initial_overlap_mm3);
}

TEST_F(TraceFile, TheSameTraceGivesTheSameBytesAlsoAfterBeingRead) {
  const Trace trace = synthetic_trace(9001);
  write_trace(trace, path_);
  write_trace(trace, other_);
  const std::string first = bytes_of(path_);
  EXPECT_EQ(first, bytes_of(other_));
  write_trace(read_trace(path_), other_);  // also the power
  EXPECT_EQ(first, bytes_of(other_));
}

TEST_F(TraceFile, TheBytesAreTheSameWhateverTheNumberOfThreads) {
  const Trace trace = synthetic_trace(100'000);  // thirteen chunks of the widest columns
  write_trace(trace, path_);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  write_trace(trace, other_);
  EXPECT_EQ(bytes_of(path_), bytes_of(other_));
}

TEST_F(TraceFile, OneRowAndARatioOfNothingAreATrace) {
  Trace trace = synthetic_trace(1);
  trace.audit.energy_ratio = std::numeric_limits<double>::quiet_NaN();
  trace.bur = "bürste";  // not ASCII
  write_trace(trace, path_);
  const Trace back = read_trace(path_);
  expect_same_rows(trace, back);
  EXPECT_TRUE(std::isnan(back.audit.energy_ratio));
  EXPECT_EQ(back.bur, trace.bur);
}

TEST_F(TraceFile, EveryNthRowKeepsTheLastAndThoseWithEvents) {
  Trace trace = synthetic_trace(100);
  trace.rows[0].handle.rejected = false;
  trace.events.burs = {trace.bur};
  SessionEvent pause;
  pause.time = trace.rows[41].handle.time;
  pause.kind = EventKind::kPause;
  trace.events.events = {pause};
  const Trace sparse = every_nth_row(trace, 10);
  Trace expected = trace;
  expected.rows.clear();
  for (const std::size_t i : {0, 10, 20, 30, 40, 41, 50, 60, 70, 80, 90, 99})
    expected.rows.push_back(trace.rows[i]);
  expect_same_rows(sparse, expected);
  write_trace(sparse, path_);
  EXPECT_EQ(read_trace(path_).rows_every, 10u);
  EXPECT_EQ(read_h5_trajectory(path_).rows_every, 10u);
  expect_same_rows(read_trace(path_), expected);

  EXPECT_EQ(every_nth_row(trace, 1).rows_every, 1u);
  EXPECT_EQ(every_nth_row(trace, 1000).rows.size(), 3u);
  EXPECT_THROW(static_cast<void>(every_nth_row(trace, 0)), Error);
  EXPECT_THROW(static_cast<void>(every_nth_row(sparse, 2)), Error);
}

TEST_F(TraceFile, ATraceIsATrajectoryOfItsHandle) {
  Trace trace = synthetic_trace(100);
  trace.measured_force.assign(100, Vec3(1, 2, 3));
  write_trace(trace, path_);
  const Trajectory t = read_h5_trajectory(path_);
  ASSERT_EQ(t.samples.size(), 100u);
  for (std::size_t i = 0; i < 100; ++i) {
    const HandleSample& h = trace.rows[i].handle;
    EXPECT_EQ(t.samples[i].time, h.time);
    EXPECT_EQ(t.samples[i].pose.position, h.pose.position);
    EXPECT_EQ(t.samples[i].pose.orientation.coeffs(), h.pose.orientation.coeffs());
    EXPECT_EQ(t.samples[i].buttons, h.buttons);
  }
  EXPECT_EQ(t.measured_force, trace.measured_force);
}

TEST_F(TraceFile, WhatCouldNotBeReadIsNotWritten) {
  Trace trace = synthetic_trace(5);
  trace.rows[3].device_force.y() = std::numeric_limits<double>::quiet_NaN();
  try {
    write_trace(trace, path_);
    FAIL();
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), HasSubstr("/force/device, row 3"));
  }
  EXPECT_THROW(write_trace(Trace{}, path_), Error);
  EXPECT_THROW(write_trace(synthetic_trace(2), "no/such/folder/t.h5"), Error);
  trace = synthetic_trace(5);
  trace.measured_force.resize(4);
  EXPECT_THROW(write_trace(trace, path_), Error);
}

TEST_F(TraceFile, NoTruncationIsTakenForATrace) {
  write_trace(synthetic_trace(3000), path_);
  const std::string whole = bytes_of(path_);
  for (const double part : {0.0, 0.001, 0.01, 0.3, 0.9, 0.999}) {
    const auto length = static_cast<std::size_t>(part * static_cast<double>(whole.size()));
    std::ofstream(other_, std::ios::binary) << whole.substr(0, length);
    EXPECT_THROW(static_cast<void>(read_trace(other_)), InputError) << part;
    EXPECT_THROW(static_cast<void>(read_h5_trajectory(other_)), InputError) << part;
  }
  std::ofstream(other_, std::ios::binary) << whole.substr(0, whole.size() - 1);
  EXPECT_THAT(error_of(other_), HasSubstr("truncated"));
}

// Whatever a damaged byte does, it ends in an error or in a trace, not in a crash.
TEST_F(TraceFile, AFlippedByteIsAnErrorOrATraceNeverACrash) {
  write_trace(synthetic_trace(40), path_);
  const std::string whole = bytes_of(path_);
  const auto many = static_cast<std::size_t>(flips(80));
  int refused = 0, tried = 0;
  for (std::size_t at = 0; at < whole.size(); at += 1 + whole.size() / many, ++tried) {
    std::string damaged = whole;
    damaged[at] = static_cast<char>(damaged[at] ^ 0xff);
    std::ofstream(other_, std::ios::binary) << damaged;
    try {
      static_cast<void>(read_trace(other_));
    } catch (const InputError& e) {
      ++refused;
      EXPECT_THAT(e.what(), HasSubstr(other_ + ": "));
    }
  }
  EXPECT_GT(refused, tried / 20);
}

TEST_F(TraceFile, WhatIsNoHdf5FileIsNamed) {
  EXPECT_THAT(error_of("no/such.h5"), HasSubstr("no/such.h5: does not exist"));
  EXPECT_THAT(error_of(::testing::TempDir()), HasSubstr("is a folder"));
  std::ofstream(path_) << "time_s,x_mm,y_mm,z_mm\n0,0,0,0\n";
  EXPECT_THAT(error_of(path_), HasSubstr("is not an HDF5 file"));
}

}  // namespace
}  // namespace toothprep
