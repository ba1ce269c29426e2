// The servo's side of the display: allocates nothing, counted as calls of operator new; its time is
// printed.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <vector>

#include "../../support/allocation_counter.h"
#include "slot.h"
#include "toothprep/tools/display/display_surface.h"

namespace toothprep::testing {
namespace {

TEST(DisplayTick, AllocatesNothing) {
  const LayeredTooth tooth = slot_block();
  const Bur bur = slot_bur();
  for (const EngineKind engine : {EngineKind::kLevelset, EngineKind::kVoxel}) {
    Workpiece workpiece(tooth);
    const auto path = slot_path(5);
    Session session(bur, workpiece, slot_parameters(engine), Drive::kDirect, path.front());
    DisplaySurface surface(workpiece, {.rate = 30, .feed = {.ring_bricks = 64}});
    long in_steps = 0;
    std::vector<double> times;
    times.reserve(path.size());
    for (std::size_t i = 1; i < path.size(); ++i) {
      const long before = allocations;
      session.step(path[i]);
      const auto begin = std::chrono::steady_clock::now();
      surface.tick();
      const auto end = std::chrono::steady_clock::now();
      in_steps += allocations - before;
      times.push_back(std::chrono::duration<double, std::micro>(end - begin).count());
      if (i % 200 == 0) surface.pass();  // seldom, so that the ring is full at times
    }
    EXPECT_EQ(in_steps, 0);
    EXPECT_GT(surface.stats().feed.bricks, 100u);
    EXPECT_GT(surface.stats().feed.ring_full, 0u);
    std::sort(times.begin(), times.end());
    std::printf("tick: median %.2f, 99 %% %.2f, worst %.1f us\n", times[times.size() / 2],
                times[times.size() * 99 / 100], times.back());
    // The counter itself works: a pass allocates.
    const long counted = allocations;
    surface.finish();
    EXPECT_GT(allocations, counted);
  }
}

}  // namespace
}  // namespace toothprep::testing
