// A tick allocates nothing: counted as calls of operator new, on the thread that runs the ticks.
// The stand-in's count too, since a shared library uses the program's operator new.
#include <gtest/gtest.h>

#include "../../support/allocation_counter.h"
#include "rig.h"

namespace toothprep::testing {
namespace {

template <class MakeRig>
void expect_no_allocation(MakeRig make_rig) {
  RigSettings s;
  s.mirror.emplace();
  s.ramp = 0.05;
  const std::unique_ptr<Rig> rig = make_rig(s);
  Recorder client(Vec3(1, 0, 0));
  rig->device().start(client);
  rig->run(1);  // a driver opened at run time gets its thread's storage at the first tick
  const long before = allocations;
  rig->run(199);
  rig->inject(DeviceFault::kWarmMotors, 5);
  rig->run(100);
  const DeviceStatus status = rig->device().status();
  rig->inject(DeviceFault::kCommunication, 1);
  rig->run(100);
  EXPECT_EQ(allocations, before);
  rig->device().stop();  // no tick any more: it may
  EXPECT_EQ(status.ticks, 300);
  EXPECT_EQ(rig->device().status().last_fault, DeviceFault::kCommunication);
  const long counted = allocations;
  std::vector<int> one(1);
  EXPECT_EQ(allocations, counted + 1) << one.size();  // the counter itself works
}

TEST(HapticsNoAllocation, ASimulatedTickAllocatesNothing) {
  expect_no_allocation(
      [](const RigSettings& s) { return std::make_unique<SimulatedRig>(s, false); });
}

TEST(HapticsNoAllocation, AnOpenHapticsTickAllocatesNothing) {
  expect_no_allocation(
      [](const RigSettings& s) { return std::make_unique<OpenHapticsRig>(s, false); });
}

}  // namespace
}  // namespace toothprep::testing
