// CPU time of the haptic step, contact steps only: the paper's cylinder and ball in the enamel
// block, coupled drive, handle at 0.5 mm/s, at 0.1, 0.05 and 0.025 mm. Prints the median and the
// 99th percentile of single steps (the thread's CPU time around each, so that other threads' work
// isn't counted; reading it adds 0.2 µs, on a virtual machine more: clock_us) beside the mean of
// Google Benchmark. A thread's CPU time holds the interrupts that come meanwhile: on a virtual
// machine 50 µs every millisecond, so in one step of 10 µs out of a hundred. So each session is run
// several times, and undisturbed_... are of the least time of each step.
// Leaning: along the feed, so that its sharp edge is drawn along the slot (swept_edge.h).
//
// Split: steps that go in parts, since the bur is fast. A live loop has half a millisecond for one
// (split_step.h).
#include <benchmark/benchmark.h>
#include <time.h>

#include <algorithm>
#include <numeric>

#include "experiment.h"
#include "toothprep/step/grinding/contact.h"
#include "toothprep/step/grinding/engine.h"

namespace toothprep::testing {
namespace {

double cpu_microseconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
}

constexpr int kRuns = 5;  // of a session

// Of single steps, which are the same in each run.
class StepTimes {
 public:
  void begin_run() { next_ = 0; }
  void add(double microseconds) {
    all_.push_back(microseconds);
    if (next_ == least_.size()) least_.push_back(microseconds);
    least_[next_] = std::min(least_[next_], microseconds);
    ++next_;
  }
  std::size_t steps() const { return least_.size(); }
  void print(benchmark::State& state, const Bur& bur) {
    std::sort(all_.begin(), all_.end());
    std::sort(least_.begin(), least_.end());
    auto& counters = state.counters;
    counters["p50_us"] = quantile(all_, 0.5);
    counters["p99_us"] = quantile(all_, 0.99);
    counters["p999_us"] = quantile(all_, 0.999);
    counters["max_us"] = all_.back();
    counters["undisturbed_p50_us"] = quantile(least_, 0.5);
    counters["undisturbed_p99_us"] = quantile(least_, 0.99);
    counters["undisturbed_mean_us"] =
        std::accumulate(least_.begin(), least_.end(), 0.0) / static_cast<double>(steps());
    counters["clock_us"] = time_of_clock();
    counters["elements"] = static_cast<double>(bur.elements(kPiecesAcross * kElementSize).size());
  }

 private:
  static double quantile(const std::vector<double>& sorted, double q) {
    return sorted[static_cast<std::size_t>(q * static_cast<double>(sorted.size() - 1))];
  }
  static double time_of_clock() {
    std::vector<double> times;
    for (int i = 0; i < 1000; ++i) {
      const double start = cpu_microseconds();
      times.push_back(cpu_microseconds() - start);
    }
    std::sort(times.begin(), times.end());
    return quantile(times, 0.5);
  }

  std::vector<double> all_, least_;
  std::size_t next_ = 0;
};

// Runs the session several times; returns the last one's totals. `counts`: whether a step is timed, by its row and
// the number of its split steps.
template <class Counts>
SessionTotals run_sessions(benchmark::State& state, const Bur& bur, const LayeredTooth& tooth,
                           const Parameters& parameters, const std::vector<HandleSample>& path,
                           StepTimes& times, const Counts& counts) {
  SessionTotals totals;
  for (auto _ : state)
    for (int run = 0; run < kRuns; ++run) {
      state.PauseTiming();
      Workpiece workpiece(tooth);
      Session session(bur, workpiece, parameters, Drive::kCoupled, path.front());
      times.begin_run();
      state.ResumeTiming();
      for (std::size_t i = 1; i < path.size(); ++i) {
        const long before = session.totals().split_steps;
        const double start = cpu_microseconds();
        const StepRecord row = session.step(path[i]);
        const double time = cpu_microseconds() - start;
        if (counts(row, session.totals().split_steps - before)) times.add(time);
      }
      totals = session.totals();
    }
  return totals;
}

// `leant` along the feed, rad.
void coupled_step(benchmark::State& state, const Bur& bur,
                  const Parameters& parameters = preset_parameters("paper"), double leant = 0) {
  const double voxel = static_cast<double>(state.range(0)) / 1000;
  const double z = -bur.head_length() / 2;
  const LayeredTooth tooth = block(voxel, 8, Vec3(5, 8, 5));
  std::vector<HandleSample> path = straight_path({Vec3(0, -1, z), Vec3(0, -6, z)}, 0.5);
  const Quat lean(Eigen::AngleAxisd(leant, Vec3::UnitX()));
  for (HandleSample& sample : path) sample.pose.orientation = lean * sample.pose.orientation;
  StepTimes times;
  run_sessions(state, bur, tooth, parameters, path, times,
               [](const StepRecord& row, long) { return row.torque > 0; });
  times.print(state, bur);
  state.counters["s_per_step"] = benchmark::Counter(
      static_cast<double>(kRuns * (path.size() - 1)),
      benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

// Steps that went in parts: out of a spring stretched by millimetres, across an edge of the block
// and into a wall.
void split_step(benchmark::State& state, const Bur& bur) {
  const double voxel = static_cast<double>(state.range(0)) / 1000;
  const double z = -bur.head_length() / 2;
  const LayeredTooth tooth = block(voxel, 6, Vec3(5, 6, 5));
  const std::vector<HandleSample> path =
      straight_path({Vec3(-0.1, 0.8, z), Vec3(5.4, -4.7, z)}, 0.5);
  const Parameters parameters = paper_without_stall();
  StepTimes times;
  const SessionTotals totals =
      run_sessions(state, bur, tooth, parameters, path, times,
                   [](const StepRecord&, long splits) { return splits > 0; });
  double energy = 0;
  for (int k = 0; k < kTissueCount; ++k)
    energy += parameters.tissue[k].specific_energy * totals.removed[k];
  state.counters["audit"] = totals.torque_work / energy;
  state.counters["steps"] = static_cast<double>(times.steps());
  state.counters["cut_short"] = static_cast<double>(totals.split_steps_cut_short);
  times.print(state, bur);
}

// A law that isn't linear, with all that it may have; `droops` with the rate falling under load.
Parameters nonlinear(bool droops) {
  Parameters p = preset_parameters("paper");
  for (GrindingProperties& t : p.tissue) {
    t.size_exponent = 0.4, t.ratio_exponent = -0.2, t.reference_chip = 5e-3;
    t.rubbing_pressure = 0.1, t.up_cutting = -0.3;
  }
  if (droops) p.handpiece.model = HandpieceModel::kDroop;
  return p;
}

void NonlinearCylinder(benchmark::State& state) {
  coupled_step(state, paper_cylinder(), nonlinear(false));
}
void NonlinearBall(benchmark::State& state) { coupled_step(state, paper_ball(), nonlinear(false)); }
void DroopingNonlinearBall(benchmark::State& state) {
  coupled_step(state, paper_ball(), nonlinear(true));
}
void Cylinder(benchmark::State& state) { coupled_step(state, paper_cylinder()); }
void LeaningCylinder(benchmark::State& state) {
  coupled_step(state, paper_cylinder(), preset_parameters("paper"), 0.2);
}
void Ball(benchmark::State& state) { coupled_step(state, paper_ball()); }
void SplitCylinder(benchmark::State& state) { split_step(state, paper_cylinder()); }
void SplitBall(benchmark::State& state) { split_step(state, paper_ball()); }

BENCHMARK(Cylinder)->Arg(100)->Arg(50)->Arg(25)->Iterations(1)->Unit(benchmark::kMillisecond);
BENCHMARK(LeaningCylinder)
    ->Arg(100)
    ->Arg(50)
    ->Arg(25)
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond);
BENCHMARK(Ball)->Arg(100)->Arg(50)->Arg(25)->Iterations(1)->Unit(benchmark::kMillisecond);
BENCHMARK(NonlinearCylinder)->Arg(100)->Arg(25)->Iterations(1)->Unit(benchmark::kMillisecond);
BENCHMARK(NonlinearBall)->Arg(100)->Arg(25)->Iterations(1)->Unit(benchmark::kMillisecond);
BENCHMARK(DroopingNonlinearBall)->Arg(100)->Iterations(1)->Unit(benchmark::kMillisecond);
BENCHMARK(SplitCylinder)->Arg(100)->Arg(50)->Arg(25)->Iterations(1)->Unit(benchmark::kMillisecond);
BENCHMARK(SplitBall)->Arg(100)->Arg(50)->Arg(25)->Iterations(1)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace toothprep::testing
