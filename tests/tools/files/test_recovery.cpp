// What is left of a recording that was killed, cut off or damaged, as a file for every program.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <thread>

#include "recording_cases.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/session_recorder.h"
#include "toothprep/tools/files/session_recovery.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;
using testing::ScratchFile;
using testing::synthetic_header;
using testing::synthetic_tick;

constexpr int kRows = 1000;

std::string bytes_of(const std::string& path) {
  std::ostringstream bytes;
  bytes << std::ifstream(path, std::ios::binary).rdbuf();
  return bytes.str();
}

void write_bytes(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
}

// The bytes of a recording of kRows ticks, as a kill leaves them.
std::string killed() {
  const ScratchFile file("running");
  SessionRecorder recorder(file.path, synthetic_header(true));
  for (int i = 0; i < kRows + 77; ++i) {
    recorder.push(synthetic_tick(i, true));
    if (i % 250 == 249)  // written one after the other, as in time
      while (recorder.rows() < i + 1) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return bytes_of(file.path);
}

bool plain_h5py_opens(const std::string& path, int rows) {
  const std::string check =
      "/usr/bin/python3 -c 'import h5py, sys; f = h5py.File(sys.argv[1], \"r\"); "
      "sys.exit(f[\"/time\"].shape != (int(sys.argv[2]),))' ";
  return std::system((check + path + " " + std::to_string(rows) + " 2>/dev/null").c_str()) == 0;
}

void expect_rows(const SessionRecording& r, std::size_t rows) {
  ASSERT_EQ(r.tick.size(), rows);
  for (std::size_t i = 0; i < rows; ++i) {
    const LiveTick t = synthetic_tick(static_cast<std::int64_t>(i), true);
    ASSERT_EQ(r.tick[i], t.tick);
    ASSERT_EQ(r.header.trace.rows[i].removed_volume, t.row.removed_volume);
    ASSERT_DOUBLE_EQ(r.header.trace.rows[i].power, t.row.power);  // stored in W
    ASSERT_EQ(r.device_orientation[i].coeffs(), t.device_orientation.coeffs());
    ASSERT_EQ(r.mirror_position[i], t.mirror_position);
    ASSERT_EQ(r.flags[i], t.flags);
  }
}

TEST(Recovery, AKilledRecordingOpensEverywhereAndHoldsTheSameBits) {
  const ScratchFile file("killed"), recovered("recovered");
  write_bytes(file.path, killed());
  EXPECT_FALSE(plain_h5py_opens(file.path, kRows));
  const auto result = recover_session(file.path, recovered.path);
  ASSERT_TRUE(result);
  EXPECT_EQ(result->rows, kRows);
  EXPECT_NEAR(result->duration, (kRows - 1) * testing::kStep, 1e-12);
  EXPECT_FALSE(result->gives_up);
  ASSERT_EQ(result->lost.size(), 1u);
  EXPECT_THAT(result->lost[0], HasSubstr("after the last flush"));
  EXPECT_TRUE(plain_h5py_opens(recovered.path, kRows));
  const SessionRecording r = read_session(recovered.path);
  expect_rows(r, kRows);
  EXPECT_FALSE(r.complete);
  EXPECT_TRUE(r.recovered);
  EXPECT_EQ(r.header.limit_notes, synthetic_header().limit_notes);
  EXPECT_EQ(r.header.registration.orientation.coeffs(),
            synthetic_header().registration.orientation.coeffs());
  EXPECT_EQ(r.header.pedal, "1");
  // Once is enough.
  EXPECT_FALSE(recover_session(recovered.path, file.path));
}

TEST(Recovery, OfOneThatWasCutOffTheRowsThatAreThereStay) {
  const ScratchFile file("cut"), recovered("recovered");
  const std::string bytes = killed();
  write_bytes(file.path, bytes.substr(0, bytes.size() * 8 / 10));
  const auto result = recover_session(file.path, recovered.path);
  ASSERT_TRUE(result);
  EXPECT_TRUE(result->gives_up);
  EXPECT_EQ(result->rows % 250, 0);
  EXPECT_GE(result->rows, 500);
  EXPECT_LT(result->rows, kRows);
  expect_rows(read_session(recovered.path), static_cast<std::size_t>(result->rows));
}

// A bit of /time's second chunk: what is before it stays.
TEST(Recovery, OfADamagedOneTheRowsBeforeTheDamageStay) {
  const ScratchFile file("damaged"), recovered("recovered");
  {
    SessionRecorder recorder(file.path, synthetic_header(true));
    for (int i = 0; i < kRows; ++i) recorder.push(synthetic_tick(i, true));
    recorder.finish({{1, 2, 0.5}, "duration"});
  }
  EXPECT_FALSE(recover_session(file.path, recovered.path));  // whole
  std::string bytes = bytes_of(file.path);
  const double time = 300 * testing::kStep;
  const std::size_t at = bytes.find(std::string(reinterpret_cast<const char*>(&time), sizeof time));
  ASSERT_NE(at, std::string::npos);
  bytes[at] ^= 4;
  write_bytes(file.path, bytes);
  EXPECT_THROW(static_cast<void>(read_session(file.path)), InputError);
  const auto result = recover_session(file.path, recovered.path);
  ASSERT_TRUE(result);
  EXPECT_TRUE(result->gives_up);
  EXPECT_EQ(result->rows, 250);
  EXPECT_THAT(result->lost, ::testing::Contains(HasSubstr("/time ends at row 250 of 1000")));
  const SessionRecording r = read_session(recovered.path);
  expect_rows(r, 250);
  EXPECT_FALSE(r.complete);  // its audit is of all rows
}

TEST(Recovery, WhatIsNoRecordingIsRefused) {
  const ScratchFile text("text"), trace("trace"), out("out");
  write_bytes(text.path, "no recording");
  EXPECT_THROW(static_cast<void>(recover_session(text.path, out.path)), InputError);
  Trace plain = synthetic_header().trace;
  plain.rows = {synthetic_tick(0).row, synthetic_tick(1).row};
  write_trace(plain, trace.path);
  EXPECT_THROW(static_cast<void>(recover_session(trace.path, out.path)), InputError);
  EXPECT_THROW(static_cast<void>(recover_session("/nowhere.h5", out.path)), InputError);
}

}  // namespace
}  // namespace toothprep
