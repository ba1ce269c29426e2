// What is recorded is read back, and what isn't a recording is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>
#include <sstream>
#include <thread>

#include "../../support/repetitions.h"
#include "recording_cases.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/session_columns.h"
#include "toothprep/tools/files/session_recorder.h"
#include "toothprep/tools/files/trace_columns.h"

namespace toothprep {
namespace {

using ::testing::HasSubstr;
using testing::ScratchFile;
using testing::synthetic_header;
using testing::synthetic_tick;

constexpr int kRows = 3000;  // several chunks

void record(const std::string& path, bool mirror, int rows = kRows) {
  SessionRecorder recorder(path, synthetic_header(mirror));
  for (int i = 0; i < rows; ++i) ASSERT_TRUE(recorder.push(synthetic_tick(i, mirror)));
  recorder.finish({{1.5, 2.5, 0.6}, "duration"});
  EXPECT_EQ(recorder.rows(), rows);
  EXPECT_EQ(recorder.failure(), std::nullopt);
}

std::string error_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

void expect_same_header(const SessionHeader& a, const SessionHeader& b) {
  EXPECT_EQ(a.trace.parameters_toml, b.trace.parameters_toml);
  EXPECT_EQ(a.trace.tooth_sha256, b.trace.tooth_sha256);
  EXPECT_EQ(a.trace.bur, b.trace.bur);
  EXPECT_EQ(a.trace.drive, b.trace.drive);
  EXPECT_EQ(a.trace.engine, b.trace.engine);
  EXPECT_EQ(a.trace.toothprep_version, b.trace.toothprep_version);
  EXPECT_EQ(a.trace.initial_overlap_mm3, b.trace.initial_overlap_mm3);
  EXPECT_EQ(a.device_kind, b.device_kind);
  EXPECT_EQ(a.device_name, b.device_name);
  EXPECT_EQ(a.device_model, b.device_model);
  EXPECT_EQ(a.device_vendor, b.device_vendor);
  EXPECT_EQ(a.device_driver, b.device_driver);
  EXPECT_EQ(a.device_serial, b.device_serial);
  EXPECT_EQ(a.device_firmware, b.device_firmware);
  EXPECT_EQ(a.mirror_model, b.mirror_model);
  EXPECT_EQ(a.rate_hz, b.rate_hz);
  EXPECT_EQ(a.max_force_n, b.max_force_n);
  EXPECT_EQ(a.max_continuous_force_n, b.max_continuous_force_n);
  EXPECT_EQ(a.max_stiffness_n_per_mm, b.max_stiffness_n_per_mm);
  EXPECT_EQ(a.max_damping_n_s_per_mm, b.max_damping_n_s_per_mm);
  EXPECT_EQ(a.workspace_min, b.workspace_min);
  EXPECT_EQ(a.workspace_max, b.workspace_max);
  EXPECT_EQ(a.limit_notes, b.limit_notes);
  EXPECT_EQ(a.force_limit_n, b.force_limit_n);
  EXPECT_EQ(a.force_rate_limit_n_per_s, b.force_rate_limit_n_per_s);
  ASSERT_EQ(a.safety.has_value(), b.safety.has_value());
  for (const SafetyAttribute& limit : kSafetyAttributes)
    EXPECT_EQ((*a.safety).*limit.value, (*b.safety).*limit.value) << limit.name;
  EXPECT_EQ(a.safety_switch, b.safety_switch);
  EXPECT_EQ(a.registration.position, b.registration.position);
  EXPECT_EQ(a.registration.orientation.coeffs(), b.registration.orientation.coeffs());
  EXPECT_EQ(a.protocol, b.protocol);
  EXPECT_EQ(a.pedal, b.pedal);
  EXPECT_EQ(a.host, b.host);
}

void expect_same_rows(const SessionRecording& r, int rows, bool mirror) {
  ASSERT_EQ(r.header.trace.rows.size(), static_cast<std::size_t>(rows));
  ASSERT_EQ(r.servo_time.size(), static_cast<std::size_t>(rows));
  ASSERT_EQ(r.mirror_position.size(), static_cast<std::size_t>(mirror ? rows : 0));
  for (int row = 0; row < rows; ++row) {
    const auto i = static_cast<std::size_t>(row);
    const LiveTick t = synthetic_tick(row, mirror);
    for (const TraceColumn& column : trace_columns()) {
      std::array<double, 4> written{}, read{};
      column.get(t.row, written.data());
      column.get(r.header.trace.rows[i], read.data());
      ASSERT_EQ(written, read) << column.dataset << ", row " << row;
    }
    ASSERT_EQ(r.servo_time[i], t.servo_time);
    ASSERT_EQ(r.step_seconds[i], t.step_seconds);
    ASSERT_EQ(r.force_scale[i], t.force_scale);
    ASSERT_EQ(r.tick[i], t.tick);
    ASSERT_EQ(r.missed[i], t.missed);
    ASSERT_EQ(r.flags[i], t.flags);
    ASSERT_EQ(r.fault[i], t.fault);
    ASSERT_EQ(r.device_buttons[i], t.device_buttons);
    ASSERT_EQ(r.force_commanded[i], t.commanded_force);
    ASSERT_EQ(r.force_sent[i], t.sent_force);
    ASSERT_EQ(r.device_position[i], t.device_position);
    ASSERT_EQ(r.device_orientation[i].coeffs(), t.device_orientation.coeffs());
    if (!mirror) continue;
    ASSERT_EQ(r.mirror_position[i], t.mirror_position);
    ASSERT_EQ(r.mirror_orientation[i].coeffs(), t.mirror_orientation.coeffs());
    ASSERT_EQ(r.mirror_buttons[i], t.mirror_buttons);
  }
}

TEST(SessionFile, AFinishedRecordingIsReadBackBitForBit) {
  for (const bool mirror : {false, true}) {
    const ScratchFile file("finished");
    record(file.path, mirror);
    EXPECT_TRUE(is_session_file(file.path));
    const SessionRecording r = read_session(file.path);
    expect_same_header(r.header, synthetic_header(mirror));
    expect_same_rows(r, kRows, mirror);
    EXPECT_TRUE(r.complete);
    EXPECT_EQ(r.dropped_ticks, 0);
    EXPECT_EQ(r.end_reason, "duration");
    EXPECT_EQ(r.header.trace.audit.torque_work_mj, 1.5);
    EXPECT_EQ(r.header.trace.audit.removed_energy_mj, 2.5);
    EXPECT_EQ(r.header.trace.audit.energy_ratio, 0.6);
  }
}

TEST(SessionFile, ARecordingIsATraceAndATrajectory) {
  const ScratchFile file("trace");
  record(file.path, false);
  EXPECT_TRUE(is_trace_file(file.path));
  EXPECT_EQ(read_trace(file.path).rows.size(), static_cast<std::size_t>(kRows));
  EXPECT_EQ(read_h5_trajectory(file.path).samples.size(), static_cast<std::size_t>(kRows));
}

TEST(SessionFile, ARegistrationLaidAtTheStartFollowsFromTheFirstRow) {
  const ScratchFile file("laid");
  SessionHeader header = synthetic_header();
  header.laid_at_start = true;
  const LiveTick first = synthetic_tick(0);
  {
    SessionRecorder recorder(file.path, header);
    for (int i = 0; i < 20; ++i) recorder.push(synthetic_tick(i));
    recorder.finish({});
  }
  const SessionRecording r = read_session(file.path);
  EXPECT_FALSE(r.header.laid_at_start);
  ASSERT_TRUE(r.header.registration_hand);
  EXPECT_EQ(r.header.registration_hand->position, first.device_position);
  EXPECT_EQ(r.header.registration_hand->orientation.coeffs(), first.device_orientation.coeffs());
  // x_W = R x_D + t
  EXPECT_LT((r.header.registration.orientation * first.device_position +
             r.header.registration.position - first.row.handle.pose.position)
                .norm(),
            1e-12);
}

TEST(SessionFile, ATraceIsNoRecording) {
  const ScratchFile file("plain");
  Trace trace = synthetic_header().trace;
  trace.rows = {synthetic_tick(0).row, synthetic_tick(1).row};
  write_trace(trace, file.path);
  EXPECT_FALSE(is_session_file(file.path));
  EXPECT_THAT(error_of([&] { static_cast<void>(read_session(file.path)); }),
              HasSubstr("attribute live: is missing"));
}

TEST(SessionFile, WhatIsNoHdf5FileIsRefused) {
  EXPECT_THAT(error_of([] { static_cast<void>(is_session_file("/nowhere.h5")); }),
              HasSubstr("does not exist"));
  const ScratchFile file("text");
  std::ofstream(file.path) << "no recording";
  EXPECT_THAT(error_of([&] { static_cast<void>(read_session(file.path)); }),
              HasSubstr("is not an HDF5 file"));
}

// A byte changed anywhere, every some hundred bytes: refused or read, never a crash.
TEST(SessionFile, DamagedRecordingsAreRefusedOrRead) {
  const ScratchFile file("whole"), damaged("damaged");
  record(file.path, false, 50);
  std::ostringstream whole;
  whole << std::ifstream(file.path, std::ios::binary).rdbuf();
  const std::string bytes = whole.str();
  int refused = 0;
  for (std::size_t i = 0; i < 40; ++i) {
    // All of them in the metadata, which stands in the first part of the file.
    const std::size_t at = (i * 619) % 24000;
    std::string changed = bytes;
    changed[at] = static_cast<char>(changed[at] ^ 0x5a);
    std::ofstream(damaged.path, std::ios::binary) << changed;
    try {
      static_cast<void>(read_session(damaged.path));
    } catch (const InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 0);
}

// Zeros in a block with a checksum look like a block that is being written; HDF5 by itself reads it
// a hundred times, with pauses of 10 s in all.
TEST(SessionFile, ZerosInTheMetadataAreRefusedWithoutWaitingForAWriter) {
  const ScratchFile file("whole"), damaged("damaged");
  {
    SessionRecorder recorder(file.path, synthetic_header());  // not finished: marked as growing
    for (int i = 0; i < 50; ++i) recorder.push(synthetic_tick(i));
  }
  std::ostringstream whole;
  whole << std::ifstream(file.path, std::ios::binary).rdbuf();
  const auto start = std::chrono::steady_clock::now();
  for (std::size_t at = 100; at < 4000; at += 300) {
    std::string changed = whole.str();
    std::fill_n(changed.begin() + static_cast<std::ptrdiff_t>(at), 200, '\0');
    std::ofstream(damaged.path, std::ios::binary) << changed;
    try {
      static_cast<void>(read_session(damaged.path));
    } catch (const InputError&) {
    }
  }
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(15));
}

TEST(SessionFile, WithoutFinishAllRowsAreThereButItIsNotComplete) {
  const ScratchFile file("unfinished");
  {
    SessionRecorder recorder(file.path, synthetic_header());
    for (int i = 0; i < kRows; ++i) recorder.push(synthetic_tick(i));
  }
  const SessionRecording r = read_session(file.path);
  expect_same_rows(r, kRows, false);
  EXPECT_FALSE(r.complete);
  EXPECT_TRUE(std::isnan(r.header.trace.audit.energy_ratio));
  EXPECT_EQ(r.end_reason, "");
}

TEST(SessionFile, WithoutARowThereIsNoFile) {
  const ScratchFile file("empty");
  { SessionRecorder recorder(file.path, synthetic_header()); }
  EXPECT_FALSE(std::filesystem::exists(file.path));
  std::ofstream(file.path) << "the recording of before";
  RecorderOptions options;
  options.replace = true;
  {
    SessionRecorder recorder(file.path, synthetic_header(), options);
    recorder.finish({{}, "a fault at the start"});
    EXPECT_EQ(recorder.rows(), 0);
  }
  EXPECT_EQ(std::filesystem::file_size(file.path), 23u);
}

TEST(SessionFile, NumbersThatAreNotFiniteAreStoredAsZeroAndTold) {
  const ScratchFile file("nan");
  SessionRecorder recorder(file.path, synthetic_header());
  LiveTick bad = synthetic_tick(1);
  bad.flags = kForceClamped;
  bad.row.device_force.y() = std::numeric_limits<double>::quiet_NaN();
  bad.row.bur.orientation = Quat(0, 0, 0, 0);
  LiveTick timeless = synthetic_tick(2);
  timeless.row.handle.time = std::numeric_limits<double>::quiet_NaN();
  recorder.push(synthetic_tick(0));
  recorder.push(bad);
  recorder.push(timeless);
  recorder.push(bad);  // its time was before
  recorder.push(synthetic_tick(3));
  recorder.finish({{}, "a fault's line"});
  const SessionRecording r = read_session(file.path);
  ASSERT_EQ(r.header.trace.rows.size(), 3u);
  const StepRecord& row = r.header.trace.rows[1];
  EXPECT_EQ(row.device_force, Vec3(bad.row.device_force.x(), 0, bad.row.device_force.z()));
  EXPECT_EQ(row.bur.orientation.coeffs(), Quat::Identity().coeffs());
  EXPECT_EQ(r.flags, (std::vector<std::uint32_t>{0, kForceClamped | kForceNotFinite, 3}));
  EXPECT_EQ(r.dropped_ticks, 2);
}

TEST(SessionFile, AFullRingDropsTicksAndCountsThem) {
  const ScratchFile file("full");
  SessionRecorder recorder(file.path, synthetic_header(), {64, 0.5});
  int refused = 0;
  for (int i = 0; i < 20000; ++i) refused += !recorder.push(synthetic_tick(i));
  recorder.finish({{}, "duration"});
  EXPECT_GT(refused, 0);
  const SessionRecording r = read_session(file.path);
  EXPECT_EQ(r.dropped_ticks, refused);
  EXPECT_EQ(r.header.trace.rows.size(), static_cast<std::size_t>(20000 - refused));
}

TEST(SessionFile, AFolderThatIsNotThereIsOneClearError) {
  EXPECT_THAT(error_of([] { SessionRecorder recorder("/nowhere/session.h5", synthetic_header()); }),
              HasSubstr("/nowhere/session.h5: cannot be written"));
}

TEST(SessionFile, AnOlderFileIsReplacedOnlyWhenAskedFor) {
  const ScratchFile file("older");
  std::ofstream(file.path) << "something";
  EXPECT_THAT(error_of([&] { SessionRecorder recorder(file.path, synthetic_header()); }),
              HasSubstr("File exists"));
  std::string text;
  EXPECT_TRUE(std::ifstream(file.path) >> text);
  EXPECT_EQ(text, "something");
  RecorderOptions options;
  options.replace = true;
  SessionRecorder recorder(file.path, synthetic_header(), options);
  recorder.push(synthetic_tick(0));
  std::ifstream(file.path) >> text;
  EXPECT_EQ(text, "something");  // until there are rows
  recorder.finish({{}, "duration"});
  EXPECT_EQ(read_session(file.path).tick.size(), 1u);
}

std::string bytes_of(const std::string& path) {
  std::ostringstream bytes;
  bytes << std::ifstream(path, std::ios::binary).rdbuf();
  return bytes.str();
}

// One bit anywhere, in a finished recording and in one that was not closed: refused, or nothing is
// another value.
TEST(SessionFile, AFlippedBitIsRefusedOrHarmless) {
  const ScratchFile finished("finished"), open_end("open_end"), damaged("damaged");
  record(finished.path, false, 600);
  {
    SessionRecorder recorder(open_end.path, synthetic_header());
    for (int i = 0; i < 600; ++i) recorder.push(synthetic_tick(i));
  }
  for (const std::string& path : {finished.path, open_end.path}) {
    const std::string whole = bytes_of(path);
    std::mt19937 random(18);
    const int many = flips(45);
    int refused = 0;
    for (int flip = 0; flip < many; ++flip) {
      std::string changed = whole;
      // Every other one in the first part, where the metadata stand.
      const std::size_t at = random() % (flip % 2 ? whole.size() : 60000);
      changed[at] = static_cast<char>(changed[at] ^ (1 << random() % 8));
      std::ofstream(damaged.path, std::ios::binary) << changed;
      try {
        const SessionRecording r = read_session(damaged.path);
        expect_same_header(r.header, synthetic_header());
        expect_same_rows(r, 600, false);
        EXPECT_EQ(r.complete, path == finished.path) << at;
        EXPECT_EQ(r.end_reason, path == finished.path ? "duration" : "") << at;
        if (HasFailure()) GTEST_FAIL() << "byte " << at;
      } catch (const InputError&) {
        ++refused;
      }
    }
    EXPECT_GT(refused, 2 * many / 3);
  }
}

// HDF5's SWMR readers take zeros for what lies beyond the end of a file.
TEST(SessionFile, ARecordingThatWasCutOffIsRefused) {
  const ScratchFile file("whole"), cut("cut");
  {
    SessionRecorder recorder(file.path, synthetic_header());
    for (int i = 0; i < kRows; ++i) recorder.push(synthetic_tick(i));
    while (recorder.rows() < kRows - 250) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    std::ofstream(cut.path, std::ios::binary) << bytes_of(file.path);  // as a kill leaves it
  }
  EXPECT_EQ(read_session(cut.path).tick.size(), kRows / 250 * 250u);
  for (const double share : {0.9, 0.5, 0.3}) {
    const std::string bytes = bytes_of(cut.path);
    std::filesystem::resize_file(
        cut.path, static_cast<std::size_t>(share * static_cast<double>(bytes.size())));
    EXPECT_THAT(error_of([&] { static_cast<void>(read_session(cut.path)); }), HasSubstr("cut off"));
    EXPECT_THAT(error_of([&] { static_cast<void>(read_trace(cut.path)); }), HasSubstr("cut off"));
    EXPECT_THAT(error_of([&] { static_cast<void>(read_h5_trajectory(cut.path)); }),
                HasSubstr("cut off"));
  }
}

}  // namespace
}  // namespace toothprep
