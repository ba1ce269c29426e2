// CPU time of a tick without a client's work: a simulated one, and one through the vendor's
// interface on the stand-in (whose simulated arm and locks are part of it).
#include <benchmark/benchmark.h>

#include "rig.h"

namespace toothprep::testing {
namespace {

struct Idle : ServoClient {
  Vec3 tick(const DeviceReading& reading) override { return -0.1 * reading.hand.position; }
};

void run(benchmark::State& state, Rig& rig) {
  Idle client;
  rig.device().start(client);
  for (auto _ : state) rig.run(1);
  rig.device().stop();
}

void BM_ServoAlone(benchmark::State& state) {
  Servo servo(7.9, 1e-3, 0.25);
  Idle client;
  servo.open(client);
  double time = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(servo.begin_tick(time += 1e-3, {}, nullptr, DeviceFault::kNone));
    servo.end_tick();
  }
}
BENCHMARK(BM_ServoAlone);

void BM_Simulated(benchmark::State& state) {
  SimulatedRig rig({}, false);
  run(state, rig);
}
BENCHMARK(BM_Simulated);

void BM_OpenHapticsOnStandIn(benchmark::State& state) {
  OpenHapticsRig rig({}, false);
  run(state, rig);
}
BENCHMARK(BM_OpenHapticsOnStandIn);

}  // namespace
}  // namespace toothprep::testing
