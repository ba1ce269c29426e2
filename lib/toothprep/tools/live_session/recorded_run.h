// What a run on a device is recorded to, and what is known of it at its end: the same of a session
// and of an active check.
#pragma once

#include <cstdint>
#include <string>

#include "toothprep/tools/files/session_file.h"
#include "toothprep/tools/live/live_watch.h"
#include "toothprep/tools/live/tick_statistics.h"

namespace toothprep {

// Where the record of a run goes, and what is known of it beforehand.
struct RecordTarget {
  std::string path;      // of the file
  bool replace = false;  // an existing file
  SessionHeader header;  // what the run doesn't know: version, bur, tooth, kind of device, pedal
};

struct RecordedRun {                   // of a run that is over
  LiveEnd end;                         // how it ended
  TickStatistics ticks;                // timing and limits
  std::int64_t rows = 0, dropped = 0;  // ticks in the file; ticks that the disk was too slow for
  std::string failure;                 // why the recording isn't complete; empty if it is
};

}  // namespace toothprep
