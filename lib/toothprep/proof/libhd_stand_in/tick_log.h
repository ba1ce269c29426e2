// A row per servo tick of what the first device said and what it was sent, for whoever judges a
// program by it. The file is mapped into memory that was there before the servo starts, so that a
// row costs a copy, and is whole however the program ends. Format: README.md.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace toothprep::stand_in {

enum TickFlag : std::uint32_t {
  kJumped = 1,            // the pose is given aside, or as NaN
  kStands = 2,            // the pose is given as it was
  kErrorReported = 4,     // the driver reports an error in this tick
  kUncalibrated = 8,      // calibration is lost
  kGone = 16,             // unplugged
  kSwitchOpened = 32,     // the safety switch is open
  kForceOutput = 64,      // enabled at the tick's end
  kFrameEnded = 128,      // the program ended its frame
  kMotorsReleased = 256,  // no tick: the servo stopped, or forces were switched off
};

struct TickRow {
  std::int64_t tick = 0;       // of the servo's clock; from 0
  double time = 0;             // s, CLOCK_MONOTONIC, when the tick began
  double position[3] = {};     // mm, as given
  double orientation[4] = {};  // x, y, z, w, as given
  std::uint32_t buttons = 0;   // bits
  std::uint32_t flags = 0;     // TickFlag
  double commanded[3] = {};    // N, of the frame, clamped
  double motor[3] = {};        // N, what the motors hold from now on
};
static_assert(sizeof(TickRow) == 128);

class TickLog {
 public:
  // Replaces a file. Throws Error if it can't be made.
  TickLog(const std::string& path, double rate, std::size_t most_rows);
  ~TickLog();
  TickLog(const TickLog&) = delete;
  TickLog& operator=(const TickLog&) = delete;

  // Rows beyond the most are counted only. One caller at a time.
  void add(const TickRow& row) noexcept;

 private:
  struct Head;
  Head* head_ = nullptr;
  TickRow* rows_ = nullptr;
  std::size_t most_, size_;
};

}  // namespace toothprep::stand_in
