// A tick of the device and of the rendering allocates nothing: counted as calls of operator new.
#include <gtest/gtest.h>

#include <vector>

#include "../../support/allocation_counter.h"
#include "toothprep/tools/device/linear_damper_loop.h"

namespace toothprep::testing {
namespace {

TEST(DeviceNoAllocation, TicksAllocateNothing) {
  PhantomModel model;
  model.delay_ticks = 2;
  for (const Rendering rendering : {Rendering::kDirect, Rendering::kCoupled}) {
    SimulatedPhantom phantom(model, HandModel{}, Vec3::Zero());
    LinearDamper render(rendering, 0.1, model.time_step(), Coupling{}, Vec3::Zero());
    const long before = allocations;
    for (int n = 1; n <= 500; ++n) {
      const Vec3 force = render(static_cast<std::size_t>(n), phantom.encoder_position());
      phantom.tick(force, Vec3(0.01, -0.02, 0.005) * n);
    }
    EXPECT_EQ(allocations, before);
    EXPECT_GT(phantom.true_position().norm(), 0.1);  // it did move
  }
  const long counted = allocations;
  std::vector<int> one(1);
  EXPECT_EQ(allocations, counted + 1) << one.size();  // the counter itself works
}

}  // namespace
}  // namespace toothprep::testing
