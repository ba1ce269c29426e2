// What recording costs: the servo's thread per tick, the writer's thread at 1 kHz, the disk.
#include <benchmark/benchmark.h>
#include <time.h>

#include <chrono>
#include <filesystem>
#include <thread>

#include "recording_cases.h"
#include "toothprep/tools/files/session_recorder.h"

namespace toothprep {
namespace {

double seconds(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

// One push into the ring, that another thread empties now and then.
void push(benchmark::State& state) {
  SpscRing<LiveTick> ring(8192);
  const LiveTick tick = testing::synthetic_tick(3);
  for (auto _ : state) {
    if (ring.push(tick)) continue;
    state.PauseTiming();
    ring.consume([](const LiveTick&) {});
    state.ResumeTiming();
  }
  state.counters["tick_bytes"] = sizeof(LiveTick);
}
BENCHMARK(push);

// Ten seconds at 1 kHz. Counters: CPU of the writer's thread as a share of one core, and the file.
void writer_at_1_khz(benchmark::State& state) {
  constexpr int kTicks = 10'000;
  const testing::ScratchFile file("bench");
  double writer = 0, pushing = 0, bytes = 0;
  for (auto _ : state) {
    SessionRecorder recorder(file.path, testing::synthetic_header(true));
    const double all = seconds(CLOCK_PROCESS_CPUTIME_ID), own = seconds(CLOCK_THREAD_CPUTIME_ID);
    auto next = std::chrono::steady_clock::now();
    for (int i = 0; i < kTicks; ++i) {
      const LiveTick tick = testing::synthetic_tick(i, true);
      const double before = seconds(CLOCK_THREAD_CPUTIME_ID);
      recorder.push(tick);
      pushing += seconds(CLOCK_THREAD_CPUTIME_ID) - before;
      std::this_thread::sleep_until(next += std::chrono::milliseconds(1));
    }
    writer += (seconds(CLOCK_PROCESS_CPUTIME_ID) - all) - (seconds(CLOCK_THREAD_CPUTIME_ID) - own);
    recorder.finish({{}, "duration"});
    bytes = static_cast<double>(std::filesystem::file_size(file.path));
  }
  const double ticks = kTicks * static_cast<double>(state.iterations());
  state.counters["writer_percent_of_a_core"] = 100 * writer / (ticks * 1e-3);
  state.counters["push_ns_at_1_khz"] = 1e9 * pushing / ticks;
  state.counters["megabytes_per_minute"] = bytes / kTicks * 60'000 / 1e6;
}
BENCHMARK(writer_at_1_khz)->Iterations(1)->Unit(benchmark::kSecond);

}  // namespace
}  // namespace toothprep
