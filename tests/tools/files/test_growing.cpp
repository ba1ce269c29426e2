// A recording while it grows, after its program was killed, and when the disk is full.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <thread>

#include "recording_cases.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/session_recorder.h"
#include "toothprep/tools/io/trial.h"

namespace toothprep {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;
using testing::ScratchFile;
using testing::synthetic_header;
using testing::synthetic_tick;

pid_t in_child(const std::function<int()>& work) {
  const pid_t child = fork();
  if (child == 0) {
    alarm(60);
    try {
      _exit(work());
    } catch (...) {
      _exit(99);
    }
  }
  return child;
}

int exit_of(pid_t child) {
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

void expect_whole(const SessionRecording& r) {
  for (std::size_t i = 0; i < r.tick.size(); ++i) {
    const LiveTick t = synthetic_tick(static_cast<std::int64_t>(i));
    ASSERT_EQ(r.tick[i], t.tick);
    ASSERT_EQ(r.force_commanded[i], t.commanded_force);
    ASSERT_EQ(r.header.trace.rows[i].handle.pose.position, t.row.handle.pose.position);
    ASSERT_EQ(r.header.trace.rows[i].removed_volume, t.row.removed_volume);
  }
}

void wait_for_rows(const SessionRecorder& recorder, std::int64_t rows) {
  for (int i = 0; i < 1000 && recorder.rows() < rows; ++i) std::this_thread::sleep_for(10ms);
  ASSERT_GE(recorder.rows(), rows);
}

// As fast as the recorder's thread follows: however late it runs, the ring is never full.
void push_in_step(SessionRecorder& recorder, std::int64_t tick) {
  while (tick - recorder.rows() > 400 && !recorder.failure()) std::this_thread::sleep_for(1ms);
  recorder.push(synthetic_tick(tick));
}

TEST(GrowingRecording, IsReadInTheSameProcessAndInAnother) {
  const ScratchFile file("growing");
  SessionRecorder recorder(file.path, synthetic_header(), {8192, 0.02});
  std::int64_t pushed = 0;
  for (const std::int64_t rows : {20, 700, 1500, 4000}) {
    while (pushed < rows) recorder.push(synthetic_tick(pushed++));
    wait_for_rows(recorder, rows);
    const SessionRecording r = read_session(file.path);
    EXPECT_EQ(r.tick.size(), static_cast<std::size_t>(rows));
    EXPECT_FALSE(r.complete);
    expect_whole(r);
    // The child has the file open as the parent does: a program of its own is needed.
  }
  recorder.finish({{}, "duration"});
  EXPECT_TRUE(read_session(file.path).complete);
}

// A reader in a process that never wrote, against a writer that flushes every 20 ms, until there were
// a few looks.
TEST(GrowingRecording, EveryLookOfAnotherProcessIsConsistent) {
  constexpr std::int64_t kRows = 40000, kLooks = 4;
  const ScratchFile file("looked_at");
  const SharedMemory shared(sizeof(std::int64_t));
  auto* looks = reinterpret_cast<volatile std::int64_t*>(shared.data());
  const pid_t writer = in_child([&] {
    SessionRecorder recorder(file.path, synthetic_header(), {8192, 0.02});
    for (std::int64_t i = 0; i < kRows; ++i) {
      push_in_step(recorder, i);
      while (i == kRows / 2 && *looks < kLooks) std::this_thread::sleep_for(1ms);
    }
    recorder.finish({{}, "duration"});
    return static_cast<int>(recorder.dropped() != 0);
  });
  std::size_t rows = 0;
  int status = 0;
  for (bool ended = false; !ended;) {
    ended = waitpid(writer, &status, WNOHANG) != 0;  // and one look after the end
    SessionRecording r;
    try {
      r = read_session(file.path);
    } catch (const InputError& e) {
      ASSERT_EQ(rows, 0u) << e.what();  // not begun yet
      continue;
    }
    expect_whole(r);
    EXPECT_GE(r.tick.size(), rows);
    EXPECT_TRUE(r.complete || !ended);
    rows = r.tick.size();
    *looks = *looks + 1;
  }
  EXPECT_EQ(status, 0);
  EXPECT_EQ(rows, static_cast<std::size_t>(kRows));
}

TEST(GrowingRecording, H5pySeesItGrow) {
  ASSERT_EQ(std::system("/usr/bin/python3 -c 'import h5py'"), 0)
      << "scripts/install-packages installs python3-h5py";
  const ScratchFile file("h5py"), script("script"), answer("answer");
  std::ofstream(script.path) << R"(
import sys, time, h5py
f = h5py.File(sys.argv[1], "r", swmr=True)
assert f.attrs["schema"] == "toothprep-trace" and f.attrs["live"] == 1 and f.attrs["complete"] == 0
assert f["/servo/force_sent"].attrs["units"] == "N"
assert list(f["/removed/volume"].attrs["tissues"]) == ["enamel", "dentin", "pulp", "other"]
time_ = f["/time"]
first = len(time_)
for _ in range(500):
    time_.refresh()
    if len(time_) > first + 200:
        break
    time.sleep(0.01)
seen = time_[:]
assert first > 0 and len(seen) > first + 200, (first, len(seen))
assert all(abs(t - 0.001 * i) < 1e-9 for i, t in enumerate(seen))
)";
  SessionRecorder recorder(file.path, synthetic_header(), {8192, 0.1});
  std::int64_t pushed = 0;
  while (pushed < 100) recorder.push(synthetic_tick(pushed++));
  wait_for_rows(recorder, 100);
  const pid_t reader = in_child([&] {
    return std::system(("/usr/bin/python3 " + script.path + " " + file.path + " >&2").c_str()) == 0
               ? 0
               : 1;
  });
  int status = 0;
  while (waitpid(reader, &status, WNOHANG) == 0) {
    recorder.push(synthetic_tick(pushed++));
    std::this_thread::sleep_for(1ms);
  }
  EXPECT_EQ(status, 0);
}

// At 1 kHz with the usual flush. A machine that is busy may hold the recorder's thread up; a recorder
// that flushes too late is late each time.
TEST(GrowingRecording, AfterAKillAllButTheLastHalfSecondIsRead) {
  std::int64_t least_lost = std::numeric_limits<std::int64_t>::max();
  for (int attempt = 0; attempt < 4 && least_lost >= 500; ++attempt) {
    const ScratchFile file("killed");
    const SharedMemory shared(sizeof(std::int64_t));
    auto* pushed = reinterpret_cast<volatile std::int64_t*>(shared.data());
    const pid_t writer = in_child([&] {
      SessionRecorder recorder(file.path, synthetic_header());
      auto next = std::chrono::steady_clock::now();
      for (std::int64_t i = 0;; ++i) {
        recorder.push(synthetic_tick(i));
        *pushed = i + 1;
        std::this_thread::sleep_until(next += 1ms);
      }
      return 0;
    });
    std::this_thread::sleep_for(1900ms);
    kill(writer, SIGKILL);
    EXPECT_EQ(exit_of(writer), -SIGKILL);
    EXPECT_TRUE(is_session_file(file.path));
    EXPECT_TRUE(is_trace_file(file.path));
    const SessionRecording r = read_session(file.path);
    EXPECT_FALSE(r.complete);
    const auto rows = static_cast<std::int64_t>(r.tick.size());
    least_lost = std::min(least_lost, *pushed - rows);
    expect_whole(r);
    EXPECT_EQ(read_trace(file.path).rows.size(), r.tick.size());
    EXPECT_EQ(read_h5_trajectory(file.path).samples.size(), r.tick.size());
  }
  EXPECT_LT(least_lost, 500);
}

// Killed at any moment of many flushes.
TEST(GrowingRecording, IsReadWhereverTheKillHits) {
  for (int round = 0; round < 12; ++round) {
    const ScratchFile file("hit");
    const SharedMemory shared(sizeof(std::int64_t));
    auto* flushed = reinterpret_cast<volatile std::int64_t*>(shared.data());
    const pid_t writer = in_child([&] {
      SessionRecorder recorder(file.path, synthetic_header(), {8192, 0.02});
      for (std::int64_t i = 0;; ++i) {
        push_in_step(recorder, i);
        *flushed = recorder.rows();
      }
      return 0;
    });
    for (int i = 0; i < 5000 && *flushed == 0; ++i) std::this_thread::sleep_for(1ms);
    ASSERT_GT(*flushed, 0);
    std::this_thread::sleep_for(std::chrono::microseconds(7300 * round));
    kill(writer, SIGKILL);
    EXPECT_EQ(exit_of(writer), -SIGKILL);
    const SessionRecording r = read_session(file.path);
    EXPECT_GE(static_cast<std::int64_t>(r.tick.size()), *flushed);
    expect_whole(r);
  }
}

// The largest file allowed stands for the disk's end: writing fails from there on.
TEST(GrowingRecording, AFullDiskStopsTheRecordingAndNothingElse) {
  for (const rlim_t bytes : {700'000, 1'000'000, 1'234'567, 2'500'001}) {
    const ScratchFile file("disk_full");
    const SharedMemory shared(sizeof(std::int64_t));
    auto* flushed = reinterpret_cast<volatile std::int64_t*>(shared.data());
    const pid_t writer = in_child([&] {
      const rlimit limit{bytes, bytes};
      setrlimit(RLIMIT_FSIZE, &limit);
      SessionRecorder recorder(file.path, synthetic_header(), {8192, 0.02});
      std::int64_t i = 0;
      for (; i < 200000 && !recorder.failure(); ++i) push_in_step(recorder, i);
      *flushed = recorder.rows();
      if (!recorder.failure() || recorder.failure()->find("ulimit -f") == std::string::npos)
        return 1;
      for (int more = 0; more < 20000; ++more)  // more than the ring holds
        if (recorder.push(synthetic_tick(i + more))) return 2;
      if (recorder.dropped() != 0) return 3;
      // In the writer's own process, too.
      if (static_cast<std::int64_t>(read_session(file.path).tick.size()) < *flushed) return 4;
      try {
        recorder.finish({{}, "duration"});
      } catch (const Error&) {
        return 0;
      }
      return 5;
    });
    EXPECT_EQ(exit_of(writer), 0) << bytes;
    const SessionRecording r = read_session(file.path);
    EXPECT_FALSE(r.complete);
    EXPECT_GE(static_cast<std::int64_t>(r.tick.size()), *flushed);
    EXPECT_GE(*flushed, 1) << bytes;
    expect_whole(r);
  }
}

TEST(GrowingRecording, ASecondRecorderOfItsFileIsRefusedUntilTheFirstIsGone) {
  const ScratchFile file("locked"), link("link");
  RecorderOptions options;
  options.replace = true;
  const SharedMemory shared(1);
  auto* has_rows = reinterpret_cast<volatile char*>(shared.data());
  const pid_t writer = in_child([&] {
    SessionRecorder recorder(file.path, synthetic_header());
    for (std::int64_t i = 0;; ++i) {
      recorder.push(synthetic_tick(i));
      *has_rows = recorder.rows() > 0;
      std::this_thread::sleep_for(1ms);
    }
    return 0;
  });
  for (int i = 0; i < 5000 && !*has_rows; ++i) std::this_thread::sleep_for(1ms);
  std::filesystem::create_symlink(file.path, link.path);
  for (const std::string& path : {file.path, link.path}) try {
      SessionRecorder second(path, synthetic_header(), options);
      ADD_FAILURE() << path;
    } catch (const InputError& e) {
      EXPECT_EQ(e.condition(), "is being recorded by a session that still runs");
    }
  const std::size_t rows = read_session(file.path).tick.size();
  kill(writer, SIGKILL);
  EXPECT_EQ(exit_of(writer), -SIGKILL);
  EXPECT_GE(read_session(file.path).tick.size(), rows);
  SessionRecorder after(file.path, synthetic_header(), options);
  after.push(synthetic_tick(0));
  after.finish({{}, "duration"});
  EXPECT_EQ(read_session(file.path).tick.size(), 1u);
}

TEST(GrowingRecording, AFullDiskAtTheStartIsAnErrorAndLeavesNoFile) {
  const ScratchFile file("no_disk");
  const pid_t writer = in_child([&] {
    std::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{1000, 1000};
    setrlimit(RLIMIT_FSIZE, &limit);
    try {
      SessionRecorder recorder(file.path, synthetic_header());
    } catch (const Error&) {
      return access(file.path.c_str(), F_OK) == 0 ? 1 : 0;
    }
    return 2;
  });
  EXPECT_EQ(exit_of(writer), 0);
}

}  // namespace
}  // namespace toothprep
