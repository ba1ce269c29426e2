// What a comparison of a class I preparation of the molar takes, by voxel size in µm.
#include <benchmark/benchmark.h>

#include "cut_teeth.h"
#include "toothprep/tools/compare/deviation.h"
#include "toothprep/tools/compare/registration.h"
#include "toothprep/tools/compare/volumes.h"

namespace toothprep {
namespace {

struct Teeth {
  Solid original, prepared, target;
};
Teeth teeth_of(double voxel) {
  const LayeredTooth tooth = molar(voxel);
  Teeth teeth;
  teeth.original = solid_of("original", tooth);
  teeth.prepared = on_lattice(solid_of("prepared", carved(tooth, class_one(0.2))), teeth.original);
  teeth.target = on_lattice(solid_of("target", carved(tooth, class_one())), teeth.original);
  return teeth;
}

void BM_Volumes(benchmark::State& state) {
  const Teeth t = teeth_of(static_cast<double>(state.range(0)) * 1e-3);
  for (auto _ : state)
    benchmark::DoNotOptimize(compare_volumes(t.original, t.prepared, &t.target).dice);
}
void BM_Deviation(benchmark::State& state) {
  const Teeth t = teeth_of(static_cast<double>(state.range(0)) * 1e-3);
  for (auto _ : state)
    benchmark::DoNotOptimize(measure_deviation(t.original, t.prepared, t.target).rms_mm);
  state.counters["vertices"] = static_cast<double>(t.prepared.surface.vertices.size());
}
void BM_Registration(benchmark::State& state) {
  const Teeth t = teeth_of(static_cast<double>(state.range(0)) * 1e-3);
  Solid away = t.prepared;
  away.surface = moved(std::move(away.surface), odd_pose());
  for (auto _ : state)
    benchmark::DoNotOptimize(register_surfaces(away, t.original).residual_rms_mm);
}
void BM_Resampling(benchmark::State& state) {
  const Teeth t = teeth_of(static_cast<double>(state.range(0)) * 1e-3);
  for (auto _ : state)
    benchmark::DoNotOptimize(on_lattice(t.prepared, t.original, odd_pose()).beyond_box_mm3);
}
BENCHMARK(BM_Volumes)->Arg(100)->Arg(50)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();
BENCHMARK(BM_Deviation)->Arg(100)->Arg(50)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();
BENCHMARK(BM_Registration)
    ->Arg(100)
    ->Arg(50)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime();
BENCHMARK(BM_Resampling)->Arg(100)->Arg(50)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();

}  // namespace
}  // namespace toothprep
