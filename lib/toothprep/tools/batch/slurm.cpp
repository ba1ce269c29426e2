#include "toothprep/tools/batch/slurm.h"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <thread>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/batch/export_batch.h"
#include "toothprep/tools/io/child_process.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/part.h"
#include "toothprep/tools/io/process_name.h"
#include "toothprep/tools/io/write_file.h"

namespace toothprep {
namespace {
namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr int kMostIdleRounds = 4;       // one after the other in which no item ended
constexpr double kTaskSeconds = 600;     // that a task should take
constexpr std::size_t kMostTasks = 200;  // of an array, where nothing is known about the items

fs::path slurm_folder(const fs::path& folder) { return fs::absolute(folder) / ".batch" / "slurm"; }

std::string path_of_program(const std::string& name) {
  const char* path = std::getenv("PATH");
  std::istringstream folders(path ? path : "/usr/bin:/bin");
  for (std::string folder; std::getline(folders, folder, ':');)
    if (std::string file = folder + "/" + name; access(file.c_str(), X_OK) == 0) return file;
  return {};
}

std::string variable(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

struct Answer {
  bool good = false;
  std::string text, error;  // stdout, stderr
};

std::string text_of(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

// One of Slurm's programs.
Answer ask_slurm(std::vector<std::string> line) {
  const std::string name = line[0];
  line[0] = path_of_program(name);
  if (line[0].empty()) return {false, "", name + " is not installed"};
  const Part folder(fs::temp_directory_path(), "", name, true);
  const std::string out = folder.path() + "/out", error = folder.path() + "/error";
  try {
    ChildOptions options;
    options.stdout_file = out;
    options.stderr_file = error;
    const bool good = ChildProcess(line, options).wait().good();
    return {good, text_of(out), text_of(error)};
  } catch (const Error& e) {
    return {false, "", e.what()};
  }
}

// ---- Rounds

struct Round {
  int number = 0;
  std::vector<std::string> jobs;  // arrays, then the collector
  double minutes = 0, memory_mb = 0;
  std::size_t items = 0;  // that were left when it began
  int idle = 0;           // rounds before it without an item that ended
};

fs::path round_file(const fs::path& folder, int number) {
  return slurm_folder(folder) / ("round-" + std::to_string(number) + ".json");
}

std::optional<Round> read_round(const fs::path& folder, int number) {
  const Json j = Json::parse(text_of(round_file(folder, number).string()), nullptr, false);
  if (!j.is_object()) return {};
  Round r;
  r.number = number;
  for (const Json& job : j.value("jobs", Json::array())) r.jobs.push_back(job.get<std::string>());
  r.minutes = j.value("minutes", 60.0);
  r.memory_mb = j.value("memory_mb", 1000.0);
  r.items = j.value("items", std::size_t{0});
  r.idle = j.value("idle", 0);
  return r;
}

std::optional<Round> last_round(const fs::path& folder) {
  std::optional<Round> last;
  for (int n = 1;; ++n) {
    std::optional<Round> round = read_round(folder, n);
    if (!round) return last;
    last = std::move(round);
  }
}

// ---- Submitting

std::string quoted(const std::string& text) {
  std::string q = "'";
  for (const char c : text) q += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return q + "'";
}

std::string script(const SlurmOptions& s, const Round& r, const std::string& more) {
  std::string line;
  for (const std::string& word : s.command) line += quoted(word) + " ";
  std::string text = "#!/bin/sh\n";
  if (!s.partition.empty()) text += "#SBATCH --partition=" + s.partition + "\n";
  if (!s.account.empty()) text += "#SBATCH --account=" + s.account + "\n";
  text += fmt::format("#SBATCH --time={:.0f}\n#SBATCH --mem-per-cpu={:.0f}M\n",
                      std::ceil(r.minutes), std::ceil(r.memory_mb));
  for (const std::string& own : s.lines) text += "#SBATCH " + own + "\n";
  return text + "exec " + line + more + "\n";
}

std::string submit(const fs::path& file, const std::string& text,
                   const std::vector<std::string>& options) {
  write_file(file.string(), text);
  std::vector<std::string> line = {"sbatch", "--parsable", "--requeue", "--job-name=toothprep"};
  line.insert(line.end(), options.begin(), options.end());
  line.push_back(file.string());
  const Answer answer = ask_slurm(line);
  std::string id = answer.text.substr(0, answer.text.find_first_of(";\n"));
  if (!answer.good || id.empty())
    throw Error("sbatch: " + (answer.error.empty()
                                  ? "gave no job"
                                  : answer.error.substr(0, answer.error.find('\n'))));
  return id;
}

// What an item is known to take; 0: not known. Of its own step or command, the most that it took.
std::map<std::string, double> known_seconds(const BatchManifest& m, const BatchResult& known) {
  std::map<std::string, double> seconds;
  for (std::size_t i = 0; i < m.items.size(); ++i) {
    double& most = seconds[m.items[i].step + "/" + m.commands[m.items[i].command].name];
    most = std::max(most, known.seconds[i]);
  }
  return seconds;
}

// The items of each task of one array.
std::vector<std::vector<std::size_t>> tasks_of(const BatchManifest& m, const SlurmOptions& s,
                                               const std::vector<std::size_t>& items,
                                               const std::map<std::string, double>& seconds,
                                               int at_once, std::size_t most_tasks) {
  std::size_t each = s.items_per_task;
  if (each == 0) {
    double longest = 0;
    for (const std::size_t i : items)
      longest = std::max(longest,
                         seconds.at(m.items[i].step + "/" + m.commands[m.items[i].command].name));
    const double budget = std::min(kTaskSeconds, s.minutes * 60 / 3) * at_once;
    each = longest > 0 ? static_cast<std::size_t>(std::clamp(budget / longest, 1.0, 1e6))
                       : (items.size() + kMostTasks - 1) / kMostTasks;
  }
  each = std::max(each, (items.size() + most_tasks - 1) / most_tasks);
  std::vector<std::vector<std::size_t>> tasks;
  for (std::size_t at = 0; at < items.size(); at += each)
    tasks.emplace_back(
        items.begin() + static_cast<std::ptrdiff_t>(at),
        items.begin() + static_cast<std::ptrdiff_t>(std::min(at + each, items.size())));
  return tasks;
}

std::size_t most_array_tasks() {
  const Answer answer = ask_slurm({"scontrol", "show", "config"});
  const std::size_t at = answer.text.find("MaxArraySize");
  const std::size_t equal = answer.text.find('=', at);
  const long most = at == std::string::npos ? 1001 : std::atol(answer.text.c_str() + equal + 1);
  return static_cast<std::size_t>(std::clamp(most - 1, 1L, 10000L));
}

std::string joined(const std::vector<std::string>& words, const char* between) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : between) + word;
  return text;
}

void submit_round(const BatchManifest& m, const BatchOptions& o, const SlurmOptions& s,
                  const BatchResult& known, Round round) {
  const fs::path folder = slurm_folder(o.folder),
                 lists = folder / ("round-" + std::to_string(round.number));
  std::error_code error;
  fs::create_directories(lists, error);
  if (error) throw Error(lists.string() + ": cannot be made: " + error.message());
  const std::size_t most = most_array_tasks();
  const auto seconds = known_seconds(m, known);
  const std::string log = "--output=" + lists.string() + "/";
  std::string before;
  const auto depths = items_by_level(m, known.left);
  try {
    for (std::size_t d = 0; d < depths.size(); ++d) {
      const auto tasks = tasks_of(m, s, depths[d], seconds, o.at_once, most);
      const std::string base = (lists / ("depth-" + std::to_string(d) + "-")).string();
      for (std::size_t t = 0; t < tasks.size(); ++t) {
        std::string names;
        for (const std::size_t i : tasks[t]) names += m.items[i].name + "\n";
        write_file(base + std::to_string(t) + ".txt", names);
      }
      std::vector<std::string> options = {fmt::format("--array=0-{}", tasks.size() - 1),
                                          fmt::format("--cpus-per-task={}", o.at_once),
                                          log + "%A_%a.log"};
      if (!before.empty()) options.push_back("--dependency=afterany:" + before);
      before = submit(
          lists / fmt::format("depth-{}.sh", d),
          script(s, round, "--quiet --work-on " + quoted(base) + "\"$SLURM_ARRAY_TASK_ID\".txt"),
          options);
      round.jobs.push_back(before);
    }
    Round small = round;
    small.minutes = std::max(10.0, s.minutes / 4);
    small.memory_mb = s.memory_mb;
    round.jobs.push_back(
        submit(lists / "collect.sh", script(s, small, "--quiet --collect"),
               {"--dependency=afterany:" + joined(round.jobs, ":"), log + "collect.log"}));
  } catch (const Error&) {
    if (!round.jobs.empty()) ask_slurm({"scancel", joined(round.jobs, ",")});
    throw;
  }
  const Json j = {{"jobs", round.jobs},
                  {"minutes", round.minutes},
                  {"memory_mb", round.memory_mb},
                  {"items", round.items},
                  {"idle", round.idle}};
  const std::string file = round_file(o.folder, round.number).string();
  write_file(file + ".new", json_text(j));
  fs::rename(file + ".new", file);
}

// ---- What became of the jobs

struct JobStates {
  bool known = false;
  std::map<std::string, int> counts;  // of the states' names
};

JobStates states_of(const std::vector<std::string>& jobs) {
  const Answer answer =
      ask_slurm({"squeue", "--noheader", "--states=all", "--array", "--format=%F %T"});
  JobStates states;
  if (!answer.good) return states;
  states.known = true;
  std::istringstream lines(answer.text);
  for (std::string job, state; lines >> job >> state;)
    if (std::find(jobs.begin(), jobs.end(), job) != jobs.end()) ++states.counts[state];
  return states;
}

bool is_over(const std::string& state) {
  static const std::vector<std::string> kOver = {"BOOT_FAIL",     "CANCELLED", "COMPLETED",
                                                 "DEADLINE",      "FAILED",    "NODE_FAIL",
                                                 "OUT_OF_MEMORY", "PREEMPTED", "TIMEOUT"};
  return std::find(kOver.begin(), kOver.end(), state) != kOver.end();
}

// Slurm's accounts, where it keeps some: they know jobs that squeue has forgotten.
JobStates states_in_accounts(const std::vector<std::string>& jobs) {
  const Answer answer = ask_slurm({"sacct", "--allocations", "--noheader", "--parsable2",
                                   "--jobs=" + joined(jobs, ","), "--format=State"});
  JobStates states;
  if (!answer.good) return states;
  states.known = true;
  std::istringstream lines(answer.text);
  for (std::string line; std::getline(lines, line);)  // "CANCELLED by 1000"
    if (const std::string state = line.substr(0, line.find(' ')); !state.empty())
      ++states.counts[state];
  return states;
}

fs::path killed_folder(const fs::path& folder) { return slurm_folder(folder) / "killed"; }

// Whether a worker of one of the jobs saw an item killed.
bool any_killed(const fs::path& folder, const std::vector<std::string>& jobs) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(killed_folder(folder), error)) {
    const std::string name = entry.path().filename().string();
    if (std::find(jobs.begin(), jobs.end(), name.substr(0, name.find('-'))) != jobs.end())
      return true;
  }
  return false;
}

// Whether Slurm wrote into a job's log that it killed it for its memory. Where jobacct_gather watches
// the limit, such a job's state is only FAILED.
bool any_log_tells_of_memory(const fs::path& folder, int round) {
  static const std::vector<std::string> kWords = {
      "exceeded memory limit", "Exceeded job memory limit", "oom-kill event", "oom_kill event"};
  std::error_code error;
  const fs::path logs = slurm_folder(folder) / fmt::format("round-{}", round);
  for (const auto& entry : fs::directory_iterator(logs, error)) {
    if (entry.path().extension() != ".log") continue;
    std::ifstream log(entry.path());
    for (std::string line; std::getline(log, line);) {
      if (line.rfind("slurmstepd", 0) != 0) continue;
      for (const std::string& words : kWords)
        if (line.find(words) != std::string::npos) return true;
    }
  }
  return false;
}

// Of the largest node of the partition (all of them without a name), MB; infinite if nobody says.
double largest_memory_mb(const std::string& partition) {
  std::vector<std::string> question = {"sinfo", "--noheader", "--Node", "--format=%m"};
  if (!partition.empty()) question.push_back("--partition=" + partition);
  const Answer answer = ask_slurm(question);
  double most = 0;
  std::istringstream lines(answer.good ? answer.text : "");
  for (std::string line; std::getline(lines, line);) most = std::max(most, std::atof(line.c_str()));
  return most > 0 ? most : std::numeric_limits<double>::infinity();
}

// "30", "30:00", "12:30:00", "2-12", "2-12:30", "2-12:30:00"; anything else ("infinite"): no limit.
double minutes_of(const std::string& text) {
  const double none = std::numeric_limits<double>::infinity();
  const std::size_t dash = text.find('-');
  const bool days = dash != std::string::npos;
  std::vector<double> parts;
  std::istringstream fields(days ? text.substr(dash + 1) : text);
  for (std::string field; std::getline(fields, field, ':');) {
    if (field.empty() || field.find_first_not_of("0123456789") != std::string::npos) return none;
    parts.push_back(std::atof(field.c_str()));
  }
  if (parts.empty() || parts.size() > 3) return none;
  if (days) {
    parts.resize(3, 0);
    return 1440 * std::atof(text.c_str()) + 60 * parts[0] + parts[1] + parts[2] / 60;
  }
  if (parts.size() == 3) return 60 * parts[0] + parts[1] + parts[2] / 60;
  return parts[0] + (parts.size() == 2 ? parts[1] / 60 : 0);
}

// That a job of the partition (without a name, of the default one) may take; infinite if nobody
// says.
double longest_job_minutes(const std::string& partition) {
  const Answer answer = ask_slurm({"sinfo", "--noheader", "--format=%P %l"});
  double longest = 0;
  std::istringstream lines(answer.good ? answer.text : "");
  for (std::string name, limit; lines >> name >> limit;) {
    const bool usual = name.back() == '*';
    if (usual) name.pop_back();
    if (partition.empty() ? usual : name == partition)
      longest = std::max(longest, minutes_of(limit));
  }
  return longest > 0 ? longest : std::numeric_limits<double>::infinity();
}

// More time or memory where a job of the last round ended for want of it, or where nobody knows;
// not more than a node has or the partition allows, since Slurm refuses such a job, or lets it wait
// for ever.
Round next_round(const BatchOptions& o, const SlurmOptions& s, const Round& last,
                 std::size_t left) {
  Round next = last;
  ++next.number;
  next.jobs.clear();
  next.items = left;
  next.idle = left < last.items ? 0 : last.idle + 1;
  const std::vector<std::string> workers(last.jobs.begin(), last.jobs.end() - 1);
  JobStates states = states_of(workers);
  for (const auto& [state, count] : states_in_accounts(workers).counts)
    states.counts[state] += count;
  const bool unknown = states.counts.empty();
  if (unknown || states.counts.count("TIMEOUT"))
    next.minutes = std::max(
        last.minutes, std::min(2 * last.minutes, std::floor(longest_job_minutes(s.partition))));
  if (unknown || states.counts.count("OUT_OF_MEMORY") || any_killed(o.folder, workers) ||
      any_log_tells_of_memory(o.folder, last.number))
    next.memory_mb = std::max(
        last.memory_mb,
        std::min(2 * last.memory_mb, std::floor(largest_memory_mb(s.partition) / o.at_once)));
  return next;
}

BatchResult looked_at(const BatchManifest& m, const BatchOptions& options) {
  BatchOptions look = options;
  look.look = true;
  look.worker.clear();
  look.claims = nullptr;
  look.progress = {};
  look.interrupted = {};
  return run_batch(m, look);
}

// The tables, once every worker has left the folder.
BatchResult write_tables(const BatchManifest& m, const BatchOptions& options) {
  BatchOptions write = options;
  write.selection.names = std::vector<std::string>{};
  write.tables_of_all = true;
  return run_batch(m, write);
}

}  // namespace

std::string submit_to_slurm(const BatchManifest& m, const BatchOptions& o, const SlurmOptions& s) {
  if (path_of_program("sbatch").empty())
    throw Error(
        "--runner slurm: sbatch is not installed here; use a node that submits jobs, or the local "
        "runner");
  if (const double longest = longest_job_minutes(s.partition); s.minutes > longest)
    throw Error(
        fmt::format("--job-minutes {:g}: jobs of the partition may take {:g} minutes at most; give "
                    "that or less",
                    s.minutes, std::floor(longest)));
  std::error_code error;
  fs::create_directories(slurm_folder(o.folder), error);
  if (error || access(slurm_folder(o.folder).c_str(), W_OK) != 0)
    throw Error(o.folder + ": cannot be written");
  const std::optional<Round> last = last_round(o.folder);
  if (last && !slurm_complete(o.folder) && slurm_jobs(o.folder) != 0)
    throw Error(o.folder + ": Slurm jobs " + joined(last->jobs, ", ") +
                " are at work on it; see --status, or wait with --wait");
  const BatchResult known = looked_at(m, o);
  Round round;
  round.number = last ? last->number + 1 : 1;
  round.minutes = s.minutes;
  round.memory_mb = s.memory_mb;
  round.items = known.left.size();
  fs::remove(slurm_folder(o.folder) / "complete", error);
  submit_round(m, o, s, known, round);
  return fmt::format(
      "{}: {} items are submitted, in {} jobs: {}; --status shows how they stand, "
      "--wait waits for them",
      o.folder, known.left.size(), last_round(o.folder)->jobs.size(),
      joined(last_round(o.folder)->jobs, ", "));
}

bool collect_from_slurm(const BatchManifest& m, const BatchOptions& o, const SlurmOptions& s,
                        BatchResult& result) {
  const std::optional<Round> last = last_round(o.folder);
  if (!last) throw Error(o.folder + ": nothing was submitted for it");
  const BatchResult known = looked_at(m, o);
  const bool given_up = last->idle >= kMostIdleRounds;
  if (known.left.empty() || given_up) {
    result = write_tables(m, o);
    std::error_code error;
    fs::remove_all(fs::absolute(o.folder) / ".batch" / "claims", error);
    write_file((slurm_folder(o.folder) / "complete").string(), std::to_string(last->number) + "\n");
    return true;
  }
  submit_round(m, o, s, known, next_round(o, s, *last, known.left.size()));
  return false;
}

bool slurm_complete(const std::string& folder) {
  std::error_code error;
  return fs::exists(slurm_folder(folder) / "complete", error);
}

int slurm_jobs(const std::string& folder) {
  const auto last = last_round(folder);
  if (!last) return -1;
  const JobStates states = states_of(last->jobs);
  if (!states.known) return -1;
  int count = 0;
  for (const auto& [state, jobs] : states.counts)
    if (!is_over(state)) count += jobs;
  return count;
}

std::string slurm_status(const std::string& folder) {
  const auto last = last_round(folder);
  if (!last) return {};
  if (slurm_complete(folder)) return "Slurm: ended in round " + std::to_string(last->number);
  const JobStates states = states_of(last->jobs);
  std::string text =
      fmt::format("Slurm: round {}, jobs {}", last->number, joined(last->jobs, ", "));
  if (!states.known) return text + ": squeue gives no answer";
  for (const auto& [state, count] : states.counts) text += fmt::format("; {} {}", count, state);
  return text;
}

void note_killed(const std::string& folder, const BatchManifest& m,
                 const std::vector<std::size_t>& items) {
  if (items.empty()) return;
  std::string job = variable("SLURM_ARRAY_JOB_ID");
  if (job.empty()) job = variable("SLURM_JOB_ID");
  std::error_code error;
  fs::create_directories(killed_folder(folder), error);
  std::string names;
  for (const std::size_t i : items) names += m.items[i].name + "\n";
  write_file((killed_folder(folder) / (job + "-" + process_name() + ".txt")).string(), names);
}

ClaimOwner slurm_owner() {
  return {process_name(), variable("SLURM_JOB_ID"),
          std::atoi(variable("SLURM_RESTART_COUNT").c_str())};
}

bool ended_by_slurm(const ClaimOwner& owner) {
  if (owner.job.empty()) return false;
  const Answer answer = ask_slurm({"squeue", "--noheader", "--states=all", "--array",
                                   "--Format=JobID:30,State:30,RestartCnt:20"});
  if (!answer.good) return false;
  std::istringstream lines(answer.text);
  std::string job, state;
  for (int restarts = 0; lines >> job >> state >> restarts;)
    if (job == owner.job) return is_over(state) || restarts > owner.restart;
  return true;  // Slurm no longer knows it
}

}  // namespace toothprep
