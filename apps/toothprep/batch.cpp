// toothprep batch: many replays or scores, resumable.
#include <signal.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <thread>

#include "command.h"
#include "strictness.h"
#include "toothprep/build_info.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/batch/run_batch.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string manifest, output;
  bool redo = false, strict = false;
  double time_limit = 0;
};

volatile sig_atomic_t stop_asked = 0;
void ask_stop(int) { stop_asked = 1; }

// Ctrl-C and the like end the batch in order; as before when it leaves.
class SignalGuard {
 public:
  SignalGuard() {
    struct sigaction action {};
    action.sa_handler = ask_stop;
    for (std::size_t i = 0; i < kSignals.size(); ++i) sigaction(kSignals[i], &action, &before_[i]);
  }
  ~SignalGuard() {
    for (std::size_t i = 0; i < kSignals.size(); ++i) sigaction(kSignals[i], &before_[i], nullptr);
  }
  SignalGuard(const SignalGuard&) = delete;
  SignalGuard& operator=(const SignalGuard&) = delete;

 private:
  static constexpr std::array<int, 3> kSignals = {SIGINT, SIGTERM, SIGHUP};
  std::array<struct sigaction, 3> before_{};
};

// The commands that this program has, with their options as they really are.
std::vector<BatchCommand> commands_of(CLI::App& app) {
  std::vector<BatchCommand> commands;
  for (BatchCommand command : batch_commands()) {
    const auto subs =
        app.get_subcommands([&](const CLI::App* sub) { return sub->get_name() == command.name; });
    if (subs.empty()) continue;
    const CLI::App* sub = subs[0];
    for (const CLI::Option* option : sub->get_options())
      for (const std::string& name : option->get_lnames()) command.options.push_back(name);
    commands.push_back(std::move(command));
  }
  return commands;
}

std::string this_program() {
  std::error_code error;
  const std::filesystem::path path = std::filesystem::read_symlink("/proc/self/exe", error);
  // A program that was replaced meanwhile is still found by its process.
  return !error && std::filesystem::exists(path, error) ? path.string() : "/proc/self/exe";
}

void run(const Options& o, CLI::App& app, const Common& common) {
  const BatchManifest manifest = read_manifest(o.manifest, commands_of(app));
  BatchOptions options;
  options.folder = o.output;
  options.program = this_program();
  options.program_arguments = {"--threads", "1", "--quiet"};
  options.version = kVersion;
  options.build = build_text();
  options.at_once = common.threads > 0
                        ? common.threads
                        : static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  options.redo = o.redo;
  options.time_limit = o.time_limit;
  const SignalGuard guard;
  options.interrupted = [] { return stop_asked != 0; };
  options.progress = [&](const std::string& line) { say(common, line); };
  const BatchResult result = run_batch(manifest, options);
  if (result.interrupted)
    throw Error(o.output + ": interrupted after " + std::to_string(result.rows.size()) + " of " +
                std::to_string(manifest.items.size()) +
                " items; the same command goes on where it stopped");
  std::string failed;
  int failures = 0;
  for (const ItemRow& row : result.rows)
    if (row.failed()) {
      // Enough names to act on; the table has all.
      if (++failures <= 10) failed += (failed.empty() ? "" : ", ") + row.name;
    }
  if (failures > 10) failed += ", ...";
  std::vector<std::string> doubtful;
  for (const ItemRow& row : result.rows)
    for (const auto& [key, value] : row.figures)
      if (key == "plausible" && value == "false")
        doubtful.push_back(o.output + "/" + row.name +
                           ": its inputs or its energy audit can't be right; see its log.txt");
  const auto warned = std::count_if(result.rows.begin(), result.rows.end(), [](const ItemRow& row) {
    return row.status == "done with warning";
  });
  say(common, o.output + "/index.html, batch.csv: " + std::to_string(result.rows.size()) +
                  " items, " + std::to_string(result.run) + " run now" +
                  (warned > 0 ? ", " + std::to_string(warned) + " done with warning" : ""));
  if (failures > 0)
    throw Error(o.output + ": " + std::to_string(failures) + " of " +
                std::to_string(result.rows.size()) + " items failed: " + failed +
                "; see batch.csv and their log.txt");
  warn_or_refuse(doubtful, o.strict);
}

}  // namespace

void add_batch(CLI::App& app, const Common& common) {
  auto* sub = app.add_subcommand("batch", "Many replays or scores at a time, resumable");
  const auto o = std::make_shared<Options>();
  sub->add_option("manifest", o->manifest, "What to run on which files (.toml)")->required();
  sub->add_option("-o,--output", o->output, "Folder for the results and their table")->required();
  sub->add_flag("--strict", o->strict,
                "Exit 1 if an item's inputs or its energy audit can't be right; all is written");
  sub->add_flag("--redo", o->redo, "Also run what is done already");
  sub->add_option("--time-limit-s", o->time_limit, "End an item that takes longer (0: no limit)")
      ->check(CLI::Range(0.0, 1e7))
      ->capture_default_str();
  sub->footer(
      "A folder of students' work, scored on all cores (--threads: that many at a time):\n"
      "  [folder]\n"
      "  command = \"score\"\n"
      "  pattern = \"students/*/prepared.vdb\"\n"
      "  arguments = { original = \"molar.vdb\", type = \"crown\", report = true }\n"
      "Run again it goes on where it stopped, and repeats only what changed. A row for each item "
      "in\n"
      "batch.csv, batch.json and index.html (ranked, with pictures of scores' reports). The "
      "format: data/batch/README.md.\n"
      "Example: toothprep batch class.toml -o results");
  sub->callback([o, &app, &common] { run(*o, app, common); });
}

}  // namespace toothprep::app
