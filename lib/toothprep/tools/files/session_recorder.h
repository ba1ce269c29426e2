// Records a live session while it runs: the servo's thread puts each tick into a ring, a thread of
// the recorder's own writes them to the file (session_file.h).
//
// The file takes its final path with its first rows, a quarter of a second after the first tick: it
// is to be read while it grows, and to be there when the program was killed. Until then what stood
// there stays, and without a row nothing is left. Whatever happens it can be read up to the last
// flush:
//
//   finish()                 complete = 1, with the checksums of all
//   destructor only          complete = 0, all ticks are in it
//   disk full, write error   complete = 0; the recording stops with failure(), the session goes on
//   kill -9                  complete = 0, without the last flush_s and what the ring held
//
// (Against a power failure nothing is done: the operating system keeps written pages for a while.)
// Two recorders can't have the same path at once (path_lock.h).
//
// What readers would refuse is not written: of a tick whose numbers aren't all finite, or whose
// quaternions aren't of unit length, these are stored as 0 (the identity), and kForceNotFinite is
// set in its flags. A tick whose time isn't after the one before counts as dropped.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "toothprep/step/core/live_tick.h"
#include "toothprep/step/core/spsc_ring.h"
#include "toothprep/tools/files/session_file.h"
#include "toothprep/tools/io/part.h"
#include "toothprep/tools/io/path_lock.h"

namespace toothprep {

struct RecorderOptions {
  std::size_t capacity = 8192;  // ticks that may wait for the disk: 8 s at 1 kHz
  double flush_s = 0.25;        // of ticks at the header's rate are written at once
  bool replace = false;         // an existing file
};

// What is known only at the end.
struct SessionEnd {
  EnergyAudit audit;
  std::string reason;  // "duration", "signal", a fault's line, ...
};

class SessionRecorder {
 public:
  // Makes the file, beside `path`, and starts the thread. The header's trace has no rows yet; its
  // audit is not looked at. Throws Error, also if something stands at `path` and `replace` is not
  // set, or if another recorder has it.
  SessionRecorder(const std::string& path, const SessionHeader& header,
                  const RecorderOptions& options = {});
  ~SessionRecorder();
  SessionRecorder(const SessionRecorder&) = delete;
  SessionRecorder& operator=(const SessionRecorder&) = delete;

  // The servo's thread only: allocates nothing, locks nothing, calls nothing. False if the tick is
  // not recorded: the ring is full (counted), or the recording has stopped.
  bool push(const LiveTick& tick) noexcept;

  // Why the recording stopped, a line for the user; empty: it goes on. Any thread.
  std::optional<std::string> failure() const;

  std::int64_t rows() const noexcept { return rows_.load(std::memory_order_relaxed); }  // flushed
  std::int64_t dropped() const noexcept { return dropped_.load(std::memory_order_relaxed); }

  // No push() from now on. Writes what is left and closes the file. Throws Error if that can't be
  // done, or if the recording had stopped before. Without a row there is no file then.
  void finish(const SessionEnd& end);

 private:
  class File;

  void run() noexcept;
  void stop_thread() noexcept;
  void fail(const char* why) noexcept;
  void write(bool all);
  void take_place();

  const std::string path_;  // as it was given
  const std::filesystem::path place_;
  const bool replace_;
  const std::chrono::duration<double> flush_;
  const PathLock lock_;
  std::unique_ptr<Part> part_;  // where the file is made; none once it has its path
  SpscRing<LiveTick> ring_;
  std::unique_ptr<File> file_;  // the thread's while it runs
  std::atomic<bool> failed_{false};
  std::atomic<std::int64_t> rows_{0}, dropped_{0};
  mutable std::mutex mutex_;  // of what follows
  std::condition_variable wake_;
  bool stop_ = false;
  std::array<char, 1024> failure_{};  // text, cut off if it is longer
  std::thread thread_;
};

}  // namespace toothprep
