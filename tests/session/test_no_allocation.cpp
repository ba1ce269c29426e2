// The step allocates nothing: global operator new counts calls while stepping. A program of its
// own, since it replaces the global operators.
#include <gtest/gtest.h>

#include <cstdlib>
#include <new>

#include "experiment.h"

namespace {
long allocations = 0;
}

void* operator new(std::size_t size) {
  ++allocations;
  if (void* p = std::malloc(size)) return p;
  throw std::bad_alloc();
}
void operator delete(void* p) noexcept { std::free(p); }
void operator delete(void* p, std::size_t) noexcept { std::free(p); }

namespace toothprep::testing {
namespace {

TEST(NoAllocation, StepsThatGrindAndCarveAllocateNothing) {
  const Bur bur = paper_cylinder();
  const LayeredTooth tooth = block(0.1, 2, Vec3(6, 6, 6));
  for (const Drive drive : {Drive::kCoupled, Drive::kDirect}) {
    const auto path = straight_path({Vec3(0, 0.8, 0.4), Vec3(0.3, -3, 0.2)}, 1.5);
    Workpiece workpiece(tooth);
    Session session(bur, workpiece, preset_parameters("paper"), drive, path.front());
    const std::size_t bricks = workpiece.cut().bricks_stored();
    const long before = allocations;
    for (std::size_t i = 1; i < path.size(); ++i) session.step(path[i]);
    EXPECT_EQ(allocations, before);
    EXPECT_GT(workpiece.cut().bricks_stored(), bricks);  // it did carve into new bricks
    EXPECT_GT(session.totals().removed[0], 0);
    // The counter itself works.
    const long counted = allocations;
    std::vector<int> one(1);
    EXPECT_EQ(allocations, counted + 1) << one.size();
  }
}

}  // namespace
}  // namespace toothprep::testing
