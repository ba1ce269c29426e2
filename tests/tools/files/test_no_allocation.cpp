#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "../../support/allocation_counter.h"
#include "recording_cases.h"
#include "toothprep/tools/files/session_recorder.h"

namespace toothprep {
namespace {

// The counter counts the recorder's own thread, too, which looks into the ring every 50 ms: of a
// few batches of some 30 us it can't meet all, while a push that allocated would be in each.
TEST(SessionRecorder, PushAllocatesNothing) {
  const testing::ScratchFile file("no_allocation");
  SessionRecorder recorder(file.path, testing::synthetic_header(), {2048, 0.5});
  LiveTick tick = testing::synthetic_tick(0);
  long fewest = std::numeric_limits<long>::max();
  for (int batch = 0; batch < 5; ++batch) {  // more than the ring holds
    const long before = testing::allocations_here;
    for (int i = 0; i < 1000; ++i) {
      tick.row.handle.time += testing::kStep;
      recorder.push(tick);
    }
    fewest = std::min(fewest, testing::allocations_here - before);
  }
  EXPECT_EQ(fewest, 0);
  EXPECT_GT(recorder.dropped(), 0);
}

}  // namespace
}  // namespace toothprep
