// How well a display's surface kept up with the servo.
#pragma once

#include <cstdint>
#include <string>

namespace toothprep {

// Bricks on their way from the servo's thread to the display's.
struct FeedCounts {
  std::uint64_t ticks = 0, bricks = 0;  // bricks: handed over
  std::uint64_t largest_backlog = 0;    // bricks marked and not yet handed over, after a tick
  std::uint64_t ring_full = 0;          // ticks dropped since the ring was full
};

struct DisplayStats {                          // of the worker that meshes what changed
  std::uint64_t passes = 0, publications = 0;  // passes that changed nothing publish nothing
  double rate = 0;                             // Hz, of the worker's passes while it ran
  double longest_gap = 0;                      // s, between the starts of two passes
  std::uint64_t blocks = 0;                    // meshed again, without the first extraction
  double first_extraction = 0;                 // s
  // s, of the passes that published something.
  double pass_median = 0, pass_99 = 0, pass_worst = 0;
  // s, from the end of the step that changed a brick visibly, noted by tick(), to its mesh's
  // publication.
  double latency_median = 0, latency_99 = 0, latency_worst = 0;
  FeedCounts feed;      // of the way there
  std::string failure;  // why the worker gave up; empty while it did not
};

}  // namespace toothprep
