#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <limits>
#include <new>
#include <thread>

#include "../../support/allocation_counter.h"
#include "recording_cases.h"
#include "toothprep/tools/files/session_recorder.h"

namespace {
std::atomic<bool> no_memory = false;  // for operator new, of every thread
}

void* operator new(std::size_t size) {
  void* const place = no_memory ? nullptr : std::malloc(size);
  if (place == nullptr) throw std::bad_alloc();
  return place;
}
// Not inlined: with one of the pair inlined, g++ takes it for a mismatch.
[[gnu::noinline]] void operator delete(void* place) noexcept { std::free(place); }
[[gnu::noinline]] void operator delete(void* place, std::size_t) noexcept { std::free(place); }

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

TEST(SessionRecorder, WithoutMemoryStopsTheRecordingAndNotTheProgram) {
  const testing::ScratchFile file("no_memory");
  SessionRecorder recorder(file.path, testing::synthetic_header(), {8192, 0.05});
  LiveTick tick = testing::synthetic_tick(0);
  const auto push = [&](int count) {
    for (int i = 0; i < count; ++i) {
      tick.row.handle.time += testing::kStep;
      recorder.push(tick);
    }
  };
  push(100);
  while (recorder.rows() < 100) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  no_memory = true;
  push(8000);
  const auto stopped = [&] {  // failure() takes memory
    const std::int64_t dropped = recorder.dropped();
    return !recorder.push(tick) && recorder.dropped() == dropped;
  };
  for (int i = 0; i < 20000 && !stopped(); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  no_memory = false;
  ASSERT_TRUE(recorder.failure());
  EXPECT_NE(recorder.failure()->find("its first 100 rows can be read"), std::string::npos)
      << *recorder.failure();
}

}  // namespace
}  // namespace toothprep
