// What the display costs: one block, the first extraction, a whole run; the servo's tick; and rate
// and latency in real time.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <thread>
#include <vector>

#include "slot.h"
#include "toothprep/proof/specimen/molar.h"
#include "toothprep/tools/display/display_surface.h"

namespace toothprep::testing {
namespace {

// The block of the molar with the most triangles.
void OneBlock(benchmark::State& state) {
  const LayeredTooth tooth = make_molar({.voxel = static_cast<double>(state.range(0)) / 1000});
  const Workpiece workpiece(tooth);
  BlockMesher mesher;
  const BlockRange range = blocks_of(tooth.solid);
  Index3 largest = range.first;
  std::size_t triangles = 0;
  for (std::size_t b = 0; b < range.size(); ++b) {
    const auto n = mesher.mesh(tooth, workpiece.cut(), range.block(b)).mesh.triangles.size();
    if (n <= triangles) continue;
    triangles = n;
    largest = range.block(b);
  }
  for (auto _ : state)
    benchmark::DoNotOptimize(mesher.mesh(tooth, workpiece.cut(), largest).mesh.triangles.data());
  state.counters["triangles"] = static_cast<double>(triangles);
}
BENCHMARK(OneBlock)->Arg(100)->Arg(50)->Unit(benchmark::kMicrosecond);

void FirstExtraction(benchmark::State& state) {
  const LayeredTooth tooth = make_molar({.voxel = static_cast<double>(state.range(0)) / 1000});
  Workpiece workpiece(tooth);
  double blocks = 0, triangles = 0;
  for (auto _ : state) {
    const DisplaySurface surface(workpiece);
    state.PauseTiming();
    blocks = static_cast<double>(surface.blocks_since(0).blocks.size());
    triangles = static_cast<double>(surface.mesh().triangles.size());
    state.ResumeTiming();
  }
  state.counters["blocks"] = blocks;
  state.counters["triangles"] = triangles;
}
BENCHMARK(FirstExtraction)->Arg(100)->Arg(50)->Unit(benchmark::kMillisecond)->UseRealTime();

// A slot at 2 mm/s with a pass every 33 ticks, as at 30 Hz; all on one thread.
void Slot(benchmark::State& state) {
  const LayeredTooth tooth = slot_block(static_cast<double>(state.range(0)) / 1000);
  const Bur bur = slot_bur();
  const auto path = slot_path(2);
  for (auto _ : state) {
    Workpiece workpiece(tooth);
    Session session(bur, workpiece, slot_parameters(), Drive::kDirect, path.front());
    DisplaySurface surface(workpiece);
    std::vector<double> ticks;
    for (std::size_t i = 1; i < path.size(); ++i) {
      session.step(path[i]);
      const auto begin = std::chrono::steady_clock::now();
      surface.tick();
      ticks.push_back(
          std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begin)
              .count());
      if (i % 33 == 0) surface.pass();
    }
    std::sort(ticks.begin(), ticks.end());
    const DisplayStats s = surface.stats();
    state.counters["pass_p50_ms"] = 1e3 * s.pass_median;
    state.counters["pass_max_ms"] = 1e3 * s.pass_worst;
    state.counters["blocks_per_pass"] =
        static_cast<double>(s.blocks) / static_cast<double>(s.publications);
    state.counters["tick_p50_us"] = ticks[ticks.size() / 2];
    state.counters["tick_p99_us"] = ticks[ticks.size() * 99 / 100];
    state.counters["tick_p999_us"] = ticks[ticks.size() * 999 / 1000];
    state.counters["backlog"] = static_cast<double>(s.feed.largest_backlog);
    state.counters["bricks"] = static_cast<double>(s.feed.bricks);
  }
}
BENCHMARK(Slot)->Arg(100)->Arg(50)->Arg(25)->Iterations(1)->Unit(benchmark::kMillisecond);

// The same slot in real time: steps at 1 kHz on this thread, the worker at 30 Hz on its own.
void Live(benchmark::State& state) {
  const LayeredTooth tooth = slot_block(static_cast<double>(state.range(0)) / 1000);
  const Bur bur = slot_bur();
  const auto path = slot_path(2);
  for (auto _ : state) {
    Workpiece workpiece(tooth);
    Session session(bur, workpiece, slot_parameters(), Drive::kDirect, path.front());
    DisplaySurface surface(workpiece);
    surface.start();
    auto due = std::chrono::steady_clock::now();
    for (std::size_t i = 1; i < path.size(); ++i) {
      std::this_thread::sleep_until(due += std::chrono::milliseconds(1));
      session.step(path[i]);
      surface.tick();
    }
    surface.stop();
    const DisplayStats s = surface.stats();
    state.counters["rate_hz"] = s.rate;
    state.counters["longest_gap_ms"] = 1e3 * s.longest_gap;
    state.counters["latency_p50_ms"] = 1e3 * s.latency_median;
    state.counters["latency_p99_ms"] = 1e3 * s.latency_99;
    state.counters["latency_max_ms"] = 1e3 * s.latency_worst;
    state.counters["pass_p50_ms"] = 1e3 * s.pass_median;
    state.counters["pass_max_ms"] = 1e3 * s.pass_worst;
  }
}
BENCHMARK(Live)->Arg(100)->Arg(50)->Arg(25)->Iterations(1)->UseRealTime()->Unit(benchmark::kSecond);

}  // namespace
}  // namespace toothprep::testing
