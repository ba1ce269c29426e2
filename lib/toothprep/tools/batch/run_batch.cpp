#include "toothprep/tools/batch/run_batch.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <system_error>
#include <thread>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/tools/batch/index_page.h"
#include "toothprep/tools/io/child_process.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/io/part.h"
#include "toothprep/tools/io/rename.h"
#include "toothprep/tools/io/write_file.h"

namespace toothprep {
namespace {
namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using Clock = std::chrono::steady_clock;

constexpr const char* kSchema = "toothprep-batch-item";
constexpr double kGrace = 2;  // s between asking a child to end and killing it

// One batch at a time in a folder. Held as long as the process lives, whatever ends it.
class FolderLock {
 public:
  explicit FolderLock(const fs::path& folder)
      : file_(open((folder / ".batch.lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666)) {
    if (file_ < 0) throw Error(folder.string() + ": cannot be written: " + std::strerror(errno));
    if (flock(file_, LOCK_EX | LOCK_NB) != 0) {
      close(file_);
      throw Error(folder.string() + ": another batch is at work in this folder; wait for its end");
    }
  }
  ~FolderLock() { close(file_); }
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int file_;
};

Json read_json(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return in ? Json::parse(in, nullptr, false) : Json();
}

// item.json of an item that a batch wrote; null otherwise.
Json item_record(const fs::path& folder) {
  Json record = read_json(folder / "item.json");
  if (!record.is_object() || !record.contains("schema") || record["schema"] != kSchema) return {};
  return record;
}

// What must be the same for an item to be done.
Json identity_of(const BatchItem& item, const BatchManifest& manifest, const BatchOptions& options,
                 std::map<std::string, std::string>& hashes) {
  const BatchCommand& command = manifest.commands[item.command];
  Json line = Json::array({command.name});
  for (const auto* list : {&command.always, &item.shown})
    for (const std::string& argument : *list) line.push_back(argument);
  Json inputs = Json::object();
  for (const BatchInput& input : item.inputs) {
    auto [place, fresh] = hashes.try_emplace(input.path);
    if (fresh) place->second = sha256_of_file(input.path);
    inputs[input.shown] = place->second;
  }
  return {{"command", line}, {"inputs", inputs}, {"toothprep_version", options.version}};
}

// Every file below the folder but the batch's own, with its hash, sorted by name.
Json outputs_of(const fs::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    std::string name = entry.path().lexically_relative(folder).string();
    if (entry.is_regular_file() && name != "item.json" && name != "log.txt")
      files[name] = sha256_of_file(entry.path().string());
  }
  Json outputs = Json::object();
  for (const auto& [name, hash] : files) outputs[name] = hash;
  return outputs;
}

// The first file below an item's folder that its record doesn't name.
std::string foreign_file(const fs::path& folder, const Json& record) {
  const Json outputs = record.value("outputs", Json::object());
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    std::string name = entry.path().lexically_relative(folder).string();
    const bool ours = entry.is_directory() || name == "item.json" || name == "log.txt" ||
                      (outputs.is_object() && outputs.contains(name));
    if (entry.is_symlink() || !ours) return name;
  }
  return {};
}

bool is_done(const fs::path& folder, const Json& identity) {
  try {
    const Json record = item_record(folder);
    if (record.is_null() || record.value("status", "") != "done") return false;
    for (const auto& [key, value] : identity.items())
      if (!record.contains(key) || record[key] != value) return false;
    return record.contains("outputs") && record["outputs"] == outputs_of(folder);
  } catch (const std::exception&) {  // unreadable is not done
    return false;
  }
}

std::string last_line(const fs::path& log) {
  std::ifstream in(log, std::ios::binary);
  std::string line, last;
  while (std::getline(in, line)) {
    while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.pop_back();
    if (!line.empty()) last = line.substr(0, 1000);
  }
  // The program puts its name before an error.
  const std::string name = "toothprep: ";
  return last.rfind(name, 0) == 0 ? last.substr(name.size()) : last;
}

// "first warning", or "first warning (and 2 more)"; empty if the log has none.
std::string warnings_of(const fs::path& log) {
  const std::string beginning = "warning: ";
  std::ifstream in(log, std::ios::binary);
  std::string line, first;
  int more = 0;
  while (std::getline(in, line)) {
    if (line.rfind(beginning, 0) != 0) continue;
    if (first.empty())
      first = line.substr(beginning.size(), 1000);
    else
      ++more;
  }
  return more > 0 ? first + " (and " + std::to_string(more) + " more)" : first;
}

// One item that runs.
struct Running {
  std::size_t index = 0;
  std::unique_ptr<Part> part;
  std::unique_ptr<ChildProcess> child;
  Clock::time_point start, asked;  // when it was asked to end
  bool late = false;
};

double seconds_since(Clock::time_point t) {
  return std::chrono::duration<double>(Clock::now() - t).count();
}

class Batch {
 public:
  Batch(const BatchManifest& manifest, const BatchOptions& options)
      : m_(manifest), o_(options), dir_(fs::absolute(options.folder).lexically_normal()) {}

  BatchResult run() {
    prepare_folder();
    const FolderLock lock(dir_);
    check_folders();
    Outputs tables(true);
    const std::string csv = tables.file((dir_ / "batch.csv").string(), {".csv"});
    const std::string json = tables.file((dir_ / "batch.json").string(), {".json"});
    const std::string page = tables.file((dir_ / "index.html").string(), {".html"});
    tables.begin();
    BatchResult result;
    std::vector<ItemRow> rows(m_.items.size());
    std::vector<bool> ended(m_.items.size(), false);
    std::map<std::string, std::string> hashes;
    std::vector<Json> identities;
    for (const BatchItem& item : m_.items) {
      if (interrupted()) break;
      identities.push_back(identity_of(item, m_, o_, hashes));
    }

    std::vector<Running> running;
    std::size_t next = 0, finished = 0;
    const auto finish = [&](std::size_t i, ItemRow row, const char* how) {
      rows[i] = std::move(row);
      ended[i] = true;
      ++finished;
      if (o_.progress)
        o_.progress("[" + std::to_string(finished) + "/" + std::to_string(rows.size()) + "] " +
                    rows[i].name + ": " + how +
                    (rows[i].reason.empty() ? "" : ": " + rows[i].reason));
    };
    while (!interrupted() && (next < m_.items.size() || !running.empty())) {
      if (next < m_.items.size() &&
          running.size() < static_cast<std::size_t>(std::max(1, o_.at_once))) {
        const std::size_t i = next++;
        if (!o_.redo && is_done(folder_of(i), identities[i])) {
          finish(i, row_of(i, folder_of(i)), "was done");
          continue;
        }
        ++result.run;
        try {
          running.push_back(start(i));
        } catch (const std::exception& e) {
          finish(i, failed(i, part_of(i)->path(), identities[i], e.what(), 0), "failed");
        }
        continue;
      }
      bool any = false;
      for (std::size_t r = 0; r < running.size();) {
        if (still_runs(running[r])) {
          ++r;
          continue;
        }
        any = true;
        const std::size_t i = running[r].index;
        ItemRow row = end(running[r], identities[i]);
        const std::string how = row.status;
        running.erase(running.begin() + static_cast<std::ptrdiff_t>(r));
        finish(i, std::move(row), how.c_str());
      }
      if (!any) std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    if (interrupted()) {
      stop(running);
      result.interrupted = true;
      for (std::size_t i = 0; i < rows.size(); ++i)
        if (ended[i]) result.rows.push_back(std::move(rows[i]));
      return result;
    }
    result.rows = std::move(rows);
    write_file(csv, table_csv(result.rows));
    write_file(json, table_json(result.rows, o_.version, o_.build));
    write_file(page, index_page(result.rows, dir_.string(), o_.version));
    tables.publish();
    return result;
  }

 private:
  // Once asked to stop it stays so.
  bool interrupted() {
    stopped_ = stopped_ || (o_.interrupted && o_.interrupted());
    return stopped_;
  }
  fs::path folder_of(std::size_t i) const { return dir_ / m_.items[i].name; }
  std::unique_ptr<Part> part_of(std::size_t i) const {
    return std::make_unique<Part>(dir_, "", folder_of(i).string(), true);
  }

  void prepare_folder() const {
    std::error_code error;
    if (fs::exists(dir_, error) && !fs::is_directory(dir_, error))
      throw Error(o_.folder + ": is a file; a folder is to be written here");
    if (!fs::exists(dir_, error) && !fs::create_directory(dir_, error))
      throw Error(o_.folder + ": cannot be made; does the folder above it exist?");
    if (access(dir_.c_str(), W_OK) != 0) throw Error(o_.folder + ": cannot be written");
  }

  // A folder or table that a batch didn't write, such as a student's own, is never replaced, nor
  // one that holds what is read.
  void check_folders() const {
    const auto refuse = [](const fs::path& path, const std::string& why) {
      throw InputError(path.string(), "", why + ", so it is not replaced", "give another folder");
    };
    std::error_code error;
    for (std::size_t i = 0; i < m_.items.size(); ++i) {
      const fs::path folder = folder_of(i);
      const fs::file_status status = fs::symlink_status(folder, error);
      if (!fs::exists(status)) continue;
      const Json record = fs::is_directory(status) ? item_record(folder) : Json();
      if (record.is_null()) refuse(folder, "was not written by a batch");
      if (const std::string name = foreign_file(folder, record); !name.empty())
        refuse(folder, "holds '" + name + "', which no batch wrote");
      for (const BatchItem& item : m_.items)
        for (const BatchInput& input : item.inputs)
          if (lies_in(fs::weakly_canonical(input.path, error), fs::canonical(folder)))
            refuse(folder, "holds '" + input.shown + "', which is read");
    }
    const Json table = read_json(dir_ / "batch.json");
    const bool ours = table.is_object() && table.value("schema", "") == "toothprep-batch";
    for (const char* name : {"batch.csv", "batch.json", "index.html"})
      if (!ours && fs::exists(fs::symlink_status(dir_ / name, error)))
        refuse(dir_ / name, "was not written by a batch");
  }

  Running start(std::size_t i) const {
    const BatchItem& item = m_.items[i];
    const BatchCommand& command = m_.commands[item.command];
    Running r;
    r.index = i;
    r.part = part_of(i);
    std::vector<std::string> line = {o_.program, command.name};
    for (const auto* list : {&o_.program_arguments, &command.always, &item.arguments})
      line.insert(line.end(), list->begin(), list->end());
    const std::string folder = r.part->path(), log = folder + "/log.txt";
    r.start = Clock::now();
    r.child = std::make_unique<ChildProcess>(
        line, ChildOptions{folder, command.result_on_stdout ? folder + "/" + command.result : log,
                           log, true});
    return r;
  }

  bool still_runs(Running& r) const {
    if (!r.child->running()) return false;
    if (o_.time_limit > 0 && !r.late && seconds_since(r.start) > o_.time_limit) {
      r.late = true;
      r.asked = Clock::now();
      r.child->terminate(false);
    } else if (r.late && seconds_since(r.asked) > kGrace) {
      r.child->terminate(true);
    }
    return true;
  }

  // The row of a finished item from its folder.
  ItemRow row_of(std::size_t i, const fs::path& folder) const {
    const BatchCommand& command = m_.commands[m_.items[i].command];
    const std::string warnings = warnings_of(folder / "log.txt");
    return {m_.items[i].name, command.name, warnings.empty() ? "done" : "done with warning",
            warnings, read_figures((folder / command.result).string(), command.unrepeatable)};
  }

  ItemRow end(const Running& r, const Json& identity) const {
    const BatchItem& item = m_.items[r.index];
    const ChildEnd ended = r.child->end();
    const double seconds = seconds_since(r.start);
    const fs::path part = r.part->path();
    const std::string said = last_line(part / "log.txt");
    std::string reason;
    if (r.late) {
      reason = fmt::format("took longer than {:g} s", o_.time_limit);
    } else if (!ended.exited) {
      reason = std::string("ended by signal ") + std::to_string(ended.code) + " (" +
               strsignal(ended.code) + ")" + (said.empty() ? "" : ": " + said);
    } else if (ended.code != 0) {
      reason = said.empty() ? "exit status " + std::to_string(ended.code) : said;
    }
    std::error_code error;
    for (const std::string& file : item.made)
      if (reason.empty() && !fs::exists(part / file, error)) reason = "wrote no " + file;
    if (!reason.empty()) return failed(r.index, part, identity, reason, seconds);
    try {
      ItemRow row = row_of(r.index, part);
      Json record = {{"schema", kSchema}, {"schema_version", 1}, {"status", "done"}};
      record.update(identity);
      record["outputs"] = outputs_of(part);
      record["seconds"] = seconds;
      write_file((part / "item.json").string(), json_text(record));
      replace(r.index, part);
      return row;
    } catch (const std::exception& e) {
      // Paths inside the work folder would name a folder that is gone.
      const std::string text = e.what();
      const std::string prefix = part.string() + "/";
      return failed(r.index, part, identity,
                    text.rfind(prefix, 0) == 0 ? text.substr(prefix.size()) : text, seconds);
    }
  }

  // Of a failed item remain the log and why.
  ItemRow failed(std::size_t i, const fs::path& part, const Json& identity,
                 const std::string& reason, double seconds) const {
    try {
      for (const auto& entry : fs::directory_iterator(part))
        if (entry.path().filename() != "log.txt") fs::remove_all(entry.path());
      Json record = {
          {"schema", kSchema}, {"schema_version", 1}, {"status", "failed"}, {"reason", reason}};
      record.update(identity);
      record["seconds"] = seconds;
      write_file((part / "item.json").string(), json_text(record));
      replace(i, part);
    } catch (const std::exception&) {
      // The row has what went wrong first.
    }
    return {m_.items[i].name, m_.commands[m_.items[i].command].name, "failed", reason, {}};
  }

  // What stood there is removed with the part.
  void replace(std::size_t i, const fs::path& part) const {
    const fs::path folder = folder_of(i);
    int error = rename_to_new(part, folder);
    if (error == EEXIST || error == ENOTEMPTY) error = exchange(part, folder);
    if (error)
      throw Error(folder.string() +
                  ": cannot be written: " + std::generic_category().message(error));
  }

  void stop(std::vector<Running>& running) const {
    for (Running& r : running) r.child->terminate(false);
    const auto asked = Clock::now();
    const auto any_runs = [&] {
      return std::any_of(running.begin(), running.end(),
                         [](Running& r) { return r.child->running(); });
    };
    while (any_runs() && seconds_since(asked) < kGrace)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    running.clear();  // kills what still runs
  }

  const BatchManifest& m_;
  const BatchOptions& o_;
  fs::path dir_;
  bool stopped_ = false;
};

}  // namespace

BatchResult run_batch(const BatchManifest& manifest, const BatchOptions& options) {
  return Batch(manifest, options).run();
}

}  // namespace toothprep
