// What was done to a session, in its recording: closed, killed, recovered, and written as a trace.
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

#include "recording_cases.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/session_recorder.h"
#include "toothprep/tools/files/session_recovery.h"
#include "toothprep/tools/files/trajectory_file.h"

namespace toothprep {
namespace {

using testing::ScratchFile;
using testing::synthetic_header;
using testing::synthetic_tick;

constexpr int kRows = 1000;

SessionHeader controlled_header() {
  SessionHeader header = synthetic_header(true);
  header.trace.events.burs = {"cylinder:D1.2xL3.0", "330"};
  return header;
}

LiveTick tick_with_event(int i) {
  LiveTick tick = synthetic_tick(i, true);
  if (i == 300) tick.event = {0, EventKind::kPause, {}};
  if (i == 350) tick.event = {0, EventKind::kBur, {1}};
  if (i == 351) tick.event = {0, EventKind::kRegistration, {1, 2, 3, 0, 0, 0, 1}};
  if (i == 600) tick.event = {0, EventKind::kResume, {}};
  if (i == kRows + 20) tick.event = {0, EventKind::kEnd, {}};
  return tick;
}

void expect_events(const SessionEvents& all, std::size_t count) {
  ASSERT_EQ(all.events.size(), count);
  const int rows[] = {300, 350, 351, 600, kRows + 20};
  for (std::size_t e = 0; e < count; ++e) {
    const LiveTick tick = tick_with_event(rows[e]);
    EXPECT_EQ(all.events[e].time, tick.row.handle.time);
    EXPECT_EQ(all.events[e].kind, tick.event.kind);
    EXPECT_EQ(all.events[e].arguments, tick.event.arguments);
  }
  EXPECT_EQ(all.burs, controlled_header().trace.events.burs);
}

void record(SessionRecorder& recorder, int rows) {
  for (int i = 0; i < rows; ++i) {
    recorder.push(tick_with_event(i));
    if (i % 250 == 249)
      while (recorder.rows() < i + 1) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
}

TEST(SessionEvents, AreReadBackFromAClosedRecording) {
  const ScratchFile file("events"), trace("trace-of-events");
  SessionRecorder recorder(file.path, controlled_header());
  record(recorder, kRows + 77);
  recorder.finish({});
  const SessionRecording r = read_session(file.path);
  expect_events(r.header.trace.events, 5);
  expect_events(read_trajectory(file.path).events, 5);
  write_trace(r.header.trace, trace.path);
  expect_events(read_trace(trace.path).events, 5);
}

TEST(SessionEvents, OfAKilledRecordingAreThoseOfTheRowsThatAreThere) {
  const ScratchFile running("events-running"), file("events-killed"), whole("events-recovered");
  std::ostringstream bytes;
  {
    SessionRecorder recorder(running.path, controlled_header());
    record(recorder, kRows + 77);
    bytes << std::ifstream(running.path, std::ios::binary).rdbuf();  // as a kill leaves it
  }
  std::ofstream(file.path, std::ios::binary) << bytes.str();
  expect_events(read_session(file.path).header.trace.events, 4);
  const auto recovery = recover_session(file.path, whole.path);
  ASSERT_TRUE(recovery);
  EXPECT_EQ(recovery->rows, kRows);
  EXPECT_EQ(recovery->lost.size(), 1u);
  expect_events(read_session(whole.path).header.trace.events, 4);
}

TEST(SessionEvents, ASessionWithoutAnyIsOneThatOlderReadersTake) {
  const ScratchFile file("no-events");
  SessionRecorder recorder(file.path, controlled_header());
  for (int i = 0; i < 500; ++i) recorder.push(synthetic_tick(i, true));
  recorder.finish({});
  EXPECT_TRUE(read_session(file.path).header.trace.events.events.empty());
  EXPECT_EQ(
      std::system(("/usr/bin/python3 -c 'import h5py, sys; f = h5py.File(sys.argv[1], \"r\"); "
                   "sys.exit(int(f.attrs[\"schema_version\"]) != 1)' " +
                   file.path)
                      .c_str()),
      0);
}

}  // namespace
}  // namespace toothprep
