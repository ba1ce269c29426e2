// toothprep batch: many replays or scores, resumable.
#include <fmt/format.h>
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <limits>
#include <memory>
#include <thread>

#include "command.h"
#include "program.h"
#include "strictness.h"
#include "toothprep/build_info.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/batch/batch_plan.h"
#include "toothprep/tools/batch/export_batch.h"
#include "toothprep/tools/batch/run_batch.h"
#include "toothprep/tools/batch/slurm.h"
#include "toothprep/tools/io/child_process.h"
#include "toothprep/version.h"

namespace toothprep::app {
namespace {

struct Options {
  std::string manifest, output;
  std::string only, export_as;
  bool redo = false, strict = false, status = false, retry_failed = false, dry_run = false;
  std::string runner = "local", work_on;
  bool wait = false, collect = false;
  SlurmOptions slurm;
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

// The command, or subcommand, of that name ("specimen molar"); null if there is none.
const CLI::App* command_named(const CLI::App& app, const std::string& name) {
  const std::size_t space = name.find(' ');
  for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; }))
    if (sub->get_name() == name.substr(0, space))
      return space == std::string::npos ? sub : command_named(*sub, name.substr(space + 1));
  return nullptr;
}

// The names of all options, also of those in groups.
void add_options(const CLI::App& app, std::vector<std::string>& names) {
  for (const CLI::Option* option : app.get_options()) {
    for (const std::string& name : option->get_lnames()) names.push_back(name);
    if (option->get_lnames().empty() && option->get_positional())
      names.push_back(option->get_name());
  }
  for (const CLI::App* group : app.get_subcommands([](const CLI::App*) { return true; }))
    if (group->get_name().empty()) add_options(*group, names);
}

// The commands that this program has, with their options as they really are.
std::vector<BatchCommand> commands_of(const CLI::App& app) {
  std::vector<BatchCommand> commands;
  for (BatchCommand command : batch_commands()) {
    const CLI::App* sub = command_named(app, command.name);
    if (!sub) continue;
    add_options(*sub, command.options);
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

// An item in a forked child of this process: the program is there already.
int run_in_child(const std::vector<std::string>& arguments) {
  std::vector<std::string> line = arguments;
  line[0] = "toothprep";
  std::vector<char*> argv;
  for (std::string& argument : line) argv.push_back(argument.data());
  argv.push_back(nullptr);
  return run_program(static_cast<int>(line.size()), argv.data());
}

BatchOptions options_of(const Options& o, const Common& common) {
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
  options.selection.only = o.only;
  options.selection.failed = o.retry_failed;
  return options;
}

// Bytes that are free where the folder is, or will be; without end where nobody knows.
double free_disk(const std::string& folder) {
  namespace fs = std::filesystem;
  std::error_code error;
  fs::path place = fs::absolute(folder).lexically_normal();
  while (!fs::exists(place, error) && place.has_relative_path()) place = place.parent_path();
  const fs::space_info space = fs::space(place, error);
  return error ? std::numeric_limits<double>::infinity() : static_cast<double>(space.available);
}

// What is done, without running anything.
void print_status(const Options& o, const BatchManifest& manifest, BatchOptions options) {
  options.look = true;
  options.redo = false;
  const std::size_t count = manifest.items.size();
  const BatchResult result = run_batch(manifest, options);
  std::cout << fmt::format("{}: {} items: {} done, {} failed, {} not run yet\n", o.output, count,
                           result.rows.size() - result.failed, result.failed, result.left.size());
  if (result.failed > 0)
    for (const ItemRow& row : result.rows)
      if (row.failed()) std::cout << "failed: " << row.name << ": " << row.reason << "\n";
}

// Says how the items ended; throws if some failed.
void report(const Options& o, const BatchResult& result, const Common& common) {
  std::string failed;
  int failures = 0;
  std::size_t warned = 0;
  std::vector<std::string> doubtful;
  for (const ItemRow& row : result.rows) {
    // Enough names to act on; the table has all.
    if (row.failed() && ++failures <= 10) failed += (failed.empty() ? "" : ", ") + row.name;
    warned += row.status == "done with warning";
    for (const auto& [key, value] : row.figures)
      if (key == "plausible" && value == "false")
        doubtful.push_back(o.output + "/" + (row.folder.empty() ? row.name : row.folder) +
                           ": its inputs or its energy audit can't be right; see its log.txt");
  }
  if (failures > 10) failed += ", ...";
  say(common, o.output + "/index.html, batch.csv: " + std::to_string(result.rows.size()) +
                  " items, " + std::to_string(result.run) + " run now" +
                  (warned > 0 ? ", " + std::to_string(warned) + " done with warning" : "") +
                  (result.left.empty() ? ""
                                       : ", " + std::to_string(result.left.size()) +
                                             " not run yet, which the table leaves out"));
  if (failures > 0)
    throw Error(o.output + ": " + std::to_string(failures) + " of " +
                std::to_string(result.rows.size()) + " items failed: " + failed +
                "; see batch.csv and their log.txt");
  warn_or_refuse(doubtful, o.strict);
}

// ---- On a cluster

SlurmOptions slurm_of(const Options& o, const BatchOptions& options) {
  SlurmOptions slurm = o.slurm;
  namespace fs = std::filesystem;
  slurm.command = {options.program,
                   "batch",
                   fs::absolute(o.manifest).string(),
                   "-o",
                   fs::absolute(o.output).string(),
                   "--runner",
                   "slurm",
                   "--threads",
                   std::to_string(options.at_once)};
  const auto add = [&](const char* option, const std::string& value) {
    slurm.command.push_back(option);
    slurm.command.push_back(value);
  };
  if (o.time_limit > 0) add("--time-limit-s", fmt::format("{:g}", o.time_limit));
  if (!slurm.partition.empty()) add("--partition", slurm.partition);
  if (!slurm.account.empty()) add("--account", slurm.account);
  for (const std::string& line : slurm.lines) slurm.command.push_back("--sbatch=" + line);
  add("--job-minutes", fmt::format("{:g}", slurm.minutes));
  add("--job-memory-mb", fmt::format("{:g}", slurm.memory_mb));
  if (slurm.items_per_task > 0) add("--items-per-job", std::to_string(slurm.items_per_task));
  return slurm;
}

// A worker: the items that a file names, one a line, beside other workers.
void work_on(const Options& o, const BatchManifest& manifest, BatchOptions options) {
  std::ifstream in(o.work_on);
  if (!in) throw InputError(o.work_on, "", "cannot be read");
  std::vector<std::string> names;
  for (std::string line; std::getline(in, line);)
    if (!line.empty()) names.push_back(line);
  options.selection.names = std::move(names);
  const ClaimOwner owner = slurm_owner();
  options.worker =
      owner.job.empty() ? owner.process : "job-" + owner.job + "-" + std::to_string(owner.restart);
  Claims claims(std::filesystem::absolute(o.output), owner, ended_by_slurm);
  options.claims = &claims;
  const BatchResult result = run_batch(manifest, options);
  note_killed(o.output, manifest, result.killed);
  if (result.interrupted) throw Error(o.output + ": interrupted; what is left runs later");
}

// Waits for the jobs, or does their collector's work where that was lost.
void wait_for_slurm(const Options& o, const BatchManifest& manifest, const BatchOptions& options,
                    const Common& common) {
  std::string before;
  for (int without_jobs = 0; !slurm_complete(o.output);) {
    if (stop_asked) throw Error(o.output + ": no longer waited for; the jobs go on, see --status");
    const std::string now = slurm_status(o.output);
    if (now.empty()) throw Error(o.output + ": nothing was submitted for it");
    if (now != before) say(common, now);
    before = now;
    without_jobs = slurm_jobs(o.output) == 0 ? without_jobs + 1 : 0;
    BatchResult result;
    if (without_jobs > 2 && !slurm_complete(o.output)) {
      collect_from_slurm(manifest, options, slurm_of(o, options), result);
      without_jobs = 0;
    }
    std::this_thread::sleep_for(std::chrono::seconds(1));
  }
  BatchOptions look = options;
  look.look = true;
  look.progress = {};
  const BatchResult result = run_batch(manifest, look);
  report(o, result, common);
  if (!result.left.empty())
    throw Error(o.output + ": " + std::to_string(result.left.size()) +
                " items did not end in any job; see the logs in " + o.output + "/.batch/slurm");
}

void run_slurm(const Options& o, const BatchManifest& manifest, BatchOptions options,
               const Common& common) {
  if (common.threads == 0) options.at_once = 1;
  if (!o.work_on.empty()) return work_on(o, manifest, options);
  BatchResult result;
  if (o.collect) {
    collect_from_slurm(manifest, options, slurm_of(o, options), result);
    return;
  }
  if (!o.wait || slurm_status(o.output).empty())
    say(common, submit_to_slurm(manifest, options, slurm_of(o, options)));
  if (o.wait) wait_for_slurm(o, manifest, options, common);
}

void run(const Options& o, CLI::App& app, const Common& common) {
  ChildStarter starter(run_in_child);
  BatchManifest manifest = read_manifest(o.manifest, commands_of(app));
  const std::size_t count = manifest.items.size();
  BatchOptions options = options_of(o, common);
  options.starter = &starter;
  options.warn = warn;
  if (!o.export_as.empty()) {
    std::cout << (o.export_as == "commands" ? shell_commands(manifest, options)
                                            : snakefile(manifest, options));
    return;
  }
  if (o.status) return print_status(o, manifest, options);
  const SignalGuard guard;
  if (o.dry_run) {
    options.interrupted = [] { return stop_asked != 0; };
    std::cout << plan_text(manifest, trial_of(manifest, options), options.at_once,
                           free_disk(o.output));
    return;
  }
  if (o.runner == "slurm") {
    options.interrupted = [] { return stop_asked != 0; };
    return run_slurm(o, manifest, options, common);
  }
  options.interrupted = [] { return stop_asked != 0; };
  options.progress = [&](const std::string& line) { say(common, line); };
  const BatchResult result = run_batch(std::move(manifest), options);
  if (result.interrupted)
    throw Error(o.output + ": interrupted after " + std::to_string(result.rows.size()) + " of " +
                std::to_string(count) + " items; the same command goes on where it stopped");
  report(o, result, common);
}

}  // namespace

void add_batch(CLI::App& app, const Common& common) {
  auto* sub = app.add_subcommand(
      "batch",
      "Many commands on many files, or over a sweep of values; resumable, here or on a cluster");
  const auto o = std::make_shared<Options>();
  sub->add_option("manifest", o->manifest, "What to run on which files (.toml)")->required();
  sub->add_option("-o,--output", o->output, "Folder for the results and their table")->required();
  sub->add_flag("--strict", o->strict,
                "Exit 1 if an item's inputs or its energy audit can't be right; all is written");
  sub->add_flag("--redo", o->redo, "Also run what is done already");
  sub->add_option("--only", o->only,
                  "Run only items whose name matches this pattern (*, ?, []), and what they need");
  sub->add_flag("--retry-failed", o->retry_failed,
                "Run only items that failed before, and what needs them");
  sub->add_flag("--status", o->status, "Print what is done, and run nothing");
  sub->add_flag("--dry-run", o->dry_run,
                "Run one item of each kind in a temporary folder, and print what all will take");
  sub->add_option("--export", o->export_as,
                  "Run nothing; print the items as lines of sh (commands), or as a Snakefile")
      ->check(CLI::IsMember({"commands", "snakemake"}))
      ->excludes("--redo", "--only", "--retry-failed", "--status", "--dry-run");
  sub->add_option("--runner", o->runner, "Where items run: here, or as jobs of a cluster")
      ->check(CLI::IsMember({"local", "slurm"}))
      ->capture_default_str();
  sub->add_flag("--wait", o->wait, "slurm: wait for the end; submit if nothing was");
  sub->add_option("--partition", o->slurm.partition, "slurm: of the jobs");
  sub->add_option("--account", o->slurm.account, "slurm: of the jobs");
  sub->add_option("--sbatch", o->slurm.lines,
                  "slurm: a further option of sbatch, --sbatch=--qos=low");
  sub->add_option("--job-minutes", o->slurm.minutes, "slurm: time asked for each job")
      ->check(CLI::Range(1.0, 1e6))
      ->capture_default_str();
  sub->add_option("--job-memory-mb", o->slurm.memory_mb, "slurm: memory asked for each process")
      ->check(CLI::Range(10.0, 1e7))
      ->capture_default_str();
  sub->add_option("--items-per-job", o->slurm.items_per_task,
                  "slurm: items of each job (absent: ten minutes' worth)");
  sub->add_option("--work-on", o->work_on, "What slurm's jobs do: the items that this file names");
  sub->add_flag("--collect", o->collect, "What slurm's last job does: tables, or the next jobs");
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
