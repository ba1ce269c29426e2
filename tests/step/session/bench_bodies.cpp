// CPU time of a step and what a workpiece takes, with 1, 4 and 14 teeth loaded: a ball of 1.2 mm
// plunges into the molar's fossa and goes through its crown to the neighbour behind it and on into
// that. Coupled drive, 0.1 mm voxels. "away": steps in which no neighbour is near; "beside": those
// that touch one.
#include <benchmark/benchmark.h>
#include <time.h>

#include <algorithm>

#include "experiment.h"
#include "toothprep/proof/specimen/arch.h"

namespace toothprep::testing {
namespace {

double cpu_microseconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
}

double quantile(std::vector<double>& times, double q) {
  if (times.empty()) return 0;
  std::sort(times.begin(), times.end());
  return times[static_cast<std::size_t>(q * static_cast<double>(times.size() - 1))];
}

LayeredTooth teeth(int count) {
  ArchOptions o;
  o.neighbours = count - 1;
  return make_arch(o);
}

void Teeth(benchmark::State& state) {
  const LayeredTooth tooth = teeth(static_cast<int>(state.range(0)));
  const Bur bur = paper_ball();
  const std::vector<HandleSample> path =
      straight_path({{6.1, 5.5, 18.5}, {6.1, 5.5, 15}, {6.1, 15.5, 15}}, 1);
  constexpr double kAway = 8;  // mm in y: until there the ball is 2 mm from the neighbour
  std::vector<double> away, beside;
  for (auto _ : state) {
    const double begin = cpu_microseconds();
    Workpiece workpiece(tooth);
    state.counters["load_ms"] = (cpu_microseconds() - begin) / 1000;
    Session session(bur, workpiece, paper_without_stall(), Drive::kCoupled, path.front());
    for (std::size_t i = 1; i < path.size(); ++i) {
      const double start = cpu_microseconds();
      const StepRecord row = session.step(path[i]);
      const double time = cpu_microseconds() - start;
      if (!(row.torque > 0)) continue;
      if (row.bur.position.y() < kAway) away.push_back(time);
      if (row.other_bodies[0].body != 0) beside.push_back(time);
    }
  }
  state.counters["away_p50_us"] = quantile(away, 0.5);
  state.counters["away_p99_us"] = quantile(away, 0.99);
  state.counters["beside_p50_us"] = quantile(beside, 0.5);
  state.counters["beside_p99_us"] = quantile(beside, 0.99);
  state.counters["tooth_mb"] = static_cast<double>(memory_bytes(tooth)) / (1 << 20);
}

BENCHMARK(Teeth)->Arg(1)->Arg(4)->Arg(14)->Iterations(1)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace toothprep::testing
