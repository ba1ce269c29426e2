// What a batch itself costs: items that do nothing but write two small files, run and found done.
//   bench_batch                                    1000 items at a time
//   TOOTHPREP_ITEMS=100000 bench_batch             a large sweep: some minutes
#include <benchmark/benchmark.h>
#include <sys/resource.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "toothprep/tools/batch/run_batch.h"
#include "toothprep/tools/batch/table_h5.h"
#include "toothprep/tools/io/child_process.h"

namespace {

using namespace toothprep;
namespace fs = std::filesystem;

int do_nothing(const std::vector<std::string>& arguments) {
  std::ofstream("result.json") << "{\"force_n\": " << arguments.back() << ", \"steps\": 1000}\n";
  std::ofstream("trace.csv") << arguments.back() << "\n";
  return 0;
}

std::size_t items() {
  const char* count = std::getenv("TOOTHPREP_ITEMS");
  return count ? static_cast<std::size_t>(std::atol(count)) : 1000;
}

struct Study {
  Study() {
    std::string pattern = (fs::temp_directory_path() / "toothprep-bench-XXXXXX").string();
    folder = mkdtemp(pattern.data());
    BatchCommand nothing;
    nothing.name = "nothing";
    nothing.result = "result.json";
    nothing.made = {"trace.csv"};
    commands = {nothing};
    std::ofstream(folder / "manifest.toml")
        << "[sweep]\ndesign = \"sobol\"\nsamples = " << items()
        << "\n[sweep.over]\nu = { from = 1, to = 2 }\nk = { from = 0.1, to = 10, scale = \"log\" "
           "}\n"
           "[[sweep.step]]\nname = \"s\"\ncommand = \"nothing\"\narguments = { k = \"{k}\", u = "
           "\"{u}\" }\n";
    options.folder = (folder / "out").string();
    options.starter = &starter;
    options.version = "1";
  }
  ~Study() { fs::remove_all(folder); }
  BatchResult run() const {
    return run_batch(read_manifest((folder / "manifest.toml").string(), commands), options);
  }
  ChildStarter starter{do_nothing};  // first: forked while this process is small
  fs::path folder;
  std::vector<BatchCommand> commands;
  BatchOptions options;
};

void report(benchmark::State& state) {
  rusage used{};
  getrusage(RUSAGE_SELF, &used);
  const auto n = static_cast<double>(state.iterations()) * static_cast<double>(items());
  state.counters["per_item"] =
      benchmark::Counter(n, benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
  state.counters["peak_MB"] = static_cast<double>(used.ru_maxrss) / 1024;
}

void BM_ItemsThatDoNothing(benchmark::State& state) {
  Study study;
  study.options.at_once = static_cast<int>(state.range(0));
  study.options.redo = true;
  for (auto _ : state) benchmark::DoNotOptimize(study.run().failed);
  report(state);
}
BENCHMARK(BM_ItemsThatDoNothing)
    ->Arg(1)
    ->Arg(2)
    ->Iterations(1)
    ->UseRealTime()
    ->Unit(benchmark::kSecond);

// Until the first item could run: the manifest read, all items found done.
void BM_Start(benchmark::State& state) {
  Study study;
  study.options.at_once = 2;
  study.run();
  study.options.look = true;
  for (auto _ : state) benchmark::DoNotOptimize(study.run().run);
  report(state);
}
BENCHMARK(BM_Start)->Iterations(1)->UseRealTime()->Unit(benchmark::kSecond);

void BM_ItemsThatAreDone(benchmark::State& state) {
  Study study;
  study.options.at_once = 2;
  study.run();
  for (auto _ : state) benchmark::DoNotOptimize(study.run().run);
  report(state);
}
BENCHMARK(BM_ItemsThatAreDone)->Iterations(1)->UseRealTime()->Unit(benchmark::kSecond);

// batch.h5 of a large study: rows of 40 figures. TOOTHPREP_TABLE names the file to keep.
void BM_TableH5(benchmark::State& state) {
  const ItemRows rows(items(), [](std::size_t i) {
    ItemRow row{"cut-" + std::to_string(1000000 + i), "replay", "done", "", {}};
    for (int k = 0; k < 40; ++k)
      row.figures.emplace_back("figure_" + std::to_string(k) + "_mm",
                               std::to_string(static_cast<double>(i * (k + 1) % 7919) / 7));
    return row;
  });
  const char* kept = std::getenv("TOOTHPREP_TABLE");
  const std::string path =
      kept ? kept : (fs::temp_directory_path() / "toothprep-bench-table.h5").string();
  for (auto _ : state) write_table_h5(rows, "1", "", path);
  state.counters["MB"] = static_cast<double>(fs::file_size(path)) / 1e6;
  if (!kept) fs::remove(path);
}
BENCHMARK(BM_TableH5)->Iterations(1)->Unit(benchmark::kSecond);

}  // namespace
