// A recording whose program was killed is read wherever the sequence of its writes broke off, in the
// middle of a write, too: a kill ends a write(2) at any page's border.
#include <gtest/gtest.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "recording_cases.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/files/session_recorder.h"

namespace {

// One thing that was done to a file: bytes written, or the file cut off at `offset`.
struct Change {
  off_t offset = 0;
  std::string bytes;
  bool cut = false;
};

struct Log {
  std::mutex mutex;
  bool on = false;
  std::vector<Change> changes;

  void add(Change change) {
    const std::scoped_lock guard(mutex);
    if (on) changes.push_back(std::move(change));
  }
};

Log& written() {
  static Log log;
  return log;
}

}  // namespace

// In place of the C library's, for HDF5 as well: the same, noted down.
extern "C" ssize_t pwrite(int file, const void* bytes, size_t size, off_t offset) {
  const ssize_t done = syscall(SYS_pwrite64, file, bytes, size, offset);
  if (done > 0)
    written().add(
        {offset, std::string(static_cast<const char*>(bytes), static_cast<size_t>(done))});
  return done;
}

extern "C" int ftruncate(int file, off_t size) noexcept {
  const auto done = static_cast<int>(syscall(SYS_ftruncate, file, size));
  if (done == 0) written().add({size, {}, true});
  return done;
}

namespace toothprep {
namespace {

using testing::ScratchFile;
using testing::synthetic_header;
using testing::synthetic_tick;

constexpr int kRowsAtOnce = 20;

// The changes that a recorder made, and how many of them were made when so many rows had been
// flushed.
struct Recorded {
  std::vector<Change> changes;
  std::vector<std::size_t> after;  // [n]: n times kRowsAtOnce rows
};

Recorded record(int flushes) {
  const ScratchFile file("noted");
  Recorded recorded{{}, {0}};
  {
    const std::scoped_lock guard(written().mutex);
    written().changes.clear();
    written().on = true;
  }
  SessionRecorder recorder(file.path, synthetic_header(), {8192, 1e-3 * kRowsAtOnce});
  for (int flush = 0; flush < flushes; ++flush) {
    for (int i = 0; i < kRowsAtOnce; ++i)
      recorder.push(synthetic_tick(static_cast<std::int64_t>(flush) * kRowsAtOnce + i));
    while (recorder.rows() < static_cast<std::int64_t>(flush + 1) * kRowsAtOnce)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    const std::scoped_lock guard(written().mutex);
    recorded.after.push_back(written().changes.size());
  }
  recorder.finish({{}, "duration"});
  const std::scoped_lock guard(written().mutex);
  written().on = false;
  recorded.changes.swap(written().changes);
  return recorded;
}

// A file to which changes are made anew.
class Again {
 public:
  explicit Again(const std::string& path)
      : file_(path, std::ios::binary | std::ios::trunc), path_(path) {}

  void write(const Change& change, std::size_t from, std::size_t to) {
    file_.seekp(change.offset + static_cast<off_t>(from));
    file_.write(change.bytes.data() + from, static_cast<std::streamsize>(to - from));
    file_.flush();
  }

  void cut(const Change& change) const {
    std::filesystem::resize_file(path_, static_cast<std::uintmax_t>(change.offset));
  }

 private:
  std::ofstream file_;
  std::string path_;
};

// Nothing if the rows can be read, at least `flushed` of them and all as they were.
std::string wrong(const std::string& path, std::size_t flushed) {
  try {
    const SessionRecording r = read_session(path, ReadPolicy::kDirect);
    if (r.tick.size() < flushed) return std::to_string(r.tick.size()) + " rows";
    for (std::size_t i = 0; i < r.tick.size(); ++i) {
      const LiveTick t = synthetic_tick(static_cast<std::int64_t>(i));
      if (r.tick[i] != t.tick || r.step_seconds[i] != t.step_seconds ||
          r.header.trace.rows[i].removed_volume != t.row.removed_volume)
        return "row " + std::to_string(i);
    }
    return {};
  } catch (const InputError& e) {
    return e.what();
  }
}

// In the middle, and at each page's border: there the system looks whether the process is to end.
std::vector<std::size_t> tears_of(const Change& change) {
  constexpr std::size_t kPage = 4096;
  std::vector<std::size_t> tears = {change.bytes.size() / 2};
  for (std::size_t at = kPage - static_cast<std::size_t>(change.offset) % kPage;
       at < change.bytes.size(); at += kPage)
    tears.push_back(at);
  std::sort(tears.begin(), tears.end());
  return tears;
}

TEST(TornWrites, LeaveAllThatWasFlushed) {
  const Recorded recorded = record(2);
  const ScratchFile file("torn");
  Again again(file.path);
  std::size_t flushes = 0;
  int states = 0, damaged = 0;
  const auto judge = [&](std::size_t i, std::size_t bytes) {
    if (flushes == 0) return;
    ++states;
    const std::string why = wrong(file.path, flushes * kRowsAtOnce);
    EXPECT_EQ(why, "") << "change " << i << " of " << recorded.changes.size() << ", " << bytes
                       << " of " << recorded.changes[i].bytes.size() << " bytes";
    damaged += why.empty() ? 0 : 1;
  };
  for (std::size_t i = 0; i < recorded.changes.size() && damaged < 10; ++i) {
    while (flushes + 1 < recorded.after.size() && i >= recorded.after[flushes + 1]) ++flushes;
    const Change& change = recorded.changes[i];
    std::size_t from = 0;
    for (const std::size_t tear : tears_of(change)) {
      again.write(change, from, tear);
      judge(i, tear);
      from = tear;
    }
    again.write(change, from, change.bytes.size());
    if (change.cut) again.cut(change);
    judge(i, change.bytes.size());
  }
  EXPECT_EQ(flushes, 2u);
  EXPECT_GT(states, 200);
}

}  // namespace
}  // namespace toothprep
