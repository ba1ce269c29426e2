// Time per point of Bur::mitred_distances for rows as the removal asks for them.
#include <benchmark/benchmark.h>

#include <vector>

#include "toothprep/step/bur/bur.h"
#include "toothprep/step/bur/bur_library.h"

namespace {

void distances(benchmark::State& state, const char* spec) {
  const toothprep::Bur bur = toothprep::make_bur(spec, "");
  const int n = static_cast<int>(state.range(0));
  std::vector<float> r(n), z(n), d(n);
  for (int i = 0; i < n; ++i) {
    r[i] = 0.002f * static_cast<float>(i % 400);
    z[i] = 0.3f + 0.1f * static_cast<float>(i / 8);
  }
  for (auto _ : state) {
    bur.mitred_distances(r.data(), z.data(), d.data(), n);
    benchmark::DoNotOptimize(d.data());
    benchmark::ClobberMemory();
  }
  state.counters["s_per_point"] =
      benchmark::Counter(static_cast<double>(n), benchmark::Counter::kIsIterationInvariantRate |
                                                     benchmark::Counter::kInvert);
}

}  // namespace

BENCHMARK_CAPTURE(distances, cylinder, "cylinder:D1.2xL3.0")->Arg(8)->Arg(64)->Arg(512);
BENCHMARK_CAPTURE(distances, pear, "pear:D0.8xL1.8xA4xR0.3")->Arg(8)->Arg(64)->Arg(512);
BENCHMARK_CAPTURE(distances, flame, "flame:D1.2xL8.0xT0.2")->Arg(8)->Arg(64)->Arg(512);
BENCHMARK_CAPTURE(distances, ball, "ball:D1.2")->Arg(8)->Arg(64)->Arg(512);
