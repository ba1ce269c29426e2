#include "toothprep/tools/batch/run_batch.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <fnmatch.h>
#include <signal.h>
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
#include <queue>
#include <set>
#include <thread>
#include <unordered_set>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/batch/claims.h"
#include "toothprep/tools/batch/export_batch.h"
#include "toothprep/tools/batch/index_page.h"
#include "toothprep/tools/batch/item_store.h"
#include "toothprep/tools/batch/ledger.h"
#include "toothprep/tools/batch/summary.h"
#include "toothprep/tools/batch/table_h5.h"
#include "toothprep/tools/io/child_process.h"
#include "toothprep/tools/io/memory_limit.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/io/part.h"
#include "toothprep/tools/io/write_file.h"

namespace toothprep {
namespace {
namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr double kGrace = 2;  // s between asking a child to end and killing it

// One batch at a time in a folder, or several workers of one. Held as long as the process lives,
// whatever ends it.
class FolderLock {
 public:
  FolderLock(const fs::path& folder, bool shared)
      : file_(open((folder / ".batch.lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666)) {
    if (file_ < 0) throw Error(folder.string() + ": cannot be written: " + std::strerror(errno));
    if (flock(file_, (shared ? LOCK_SH : LOCK_EX) | LOCK_NB) != 0) {
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

// One item that runs.
struct Running {
  std::size_t index = 0;
  std::string identity;
  std::unique_ptr<Part> part;
  std::unique_ptr<ChildProcess> child;
  Clock::time_point start, asked;  // when it was asked to end
  bool late = false;
};

double seconds_since(Clock::time_point t) {
  return std::chrono::duration<double>(Clock::now() - t).count();
}

enum class State : unsigned char { kWaits, kRuns, kDone, kFailed, kLeft };

class Batch {
 public:
  Batch(std::shared_ptr<const BatchManifest> manifest, const BatchOptions& options)
      : manifest_(std::move(manifest)),
        m_(*manifest_),
        o_(options),
        dir_(fs::absolute(options.folder).lexically_normal()),
        ledger_(dir_, options.worker.empty() ? "local" : options.worker),
        store_(m_, dir_, options.version, options.build, ledger_,
               options.look || !options.worker.empty()) {}

  BatchResult run() {
    if (o_.look) {
      ledger_.load();
      walk();
      return result();
    }
    prepare_folder();
    const FolderLock lock(dir_, !o_.worker.empty());
    ledger_.load();
    if (!o_.worker.empty()) {
      walk();
      return result();
    }
    check_tables();
    store_.check_folders(o_.redo);
    Outputs tables(true);
    const std::string csv = tables.file((dir_ / "batch.csv").string(), {".csv"});
    const std::string json = tables.file((dir_ / "batch.json").string(), {".json"});
    const std::string h5 = tables.file((dir_ / "batch.h5").string(), {".h5"});
    const std::string page = tables.file((dir_ / "index.html").string(), {".html"});
    const std::string summary =
        m_.factors.empty() ? "" : tables.file((dir_ / "summary.csv").string(), {".csv"});
    tables.begin();
    walk();
    BatchResult done = result();
    if (done.interrupted) return done;
    write_table_csv(done.rows, csv);
    write_table_json(done.rows, o_.version, o_.build, json);
    write_table_h5(done.rows, o_.version, o_.build, h5);
    write_file(page, index_page(done.rows, dir_.string(), o_.version));
    if (!summary.empty()) write_file(summary, summary_csv(done.rows));
    tables.publish();
    return done;
  }

 private:
  // Once asked to stop it stays so.
  bool interrupted() {
    stopped_ = stopped_ || (o_.interrupted && o_.interrupted());
    return stopped_;
  }

  void prepare_folder() const {
    std::error_code error;
    if (fs::exists(dir_, error) && !fs::is_directory(dir_, error))
      throw Error(o_.folder + ": is a file; a folder is to be written here");
    if (!fs::exists(dir_, error) && !fs::create_directory(dir_, error))
      throw Error(o_.folder + ": cannot be made: " + error.message());
    if (access(dir_.c_str(), W_OK) != 0) throw Error(o_.folder + ": cannot be written");
  }

  // A table that a batch didn't write is never replaced.
  void check_tables() const {
    std::ifstream in(dir_ / "batch.json", std::ios::binary);
    std::string head(200, '\0');
    in.read(head.data(), static_cast<std::streamsize>(head.size()));
    const bool ours = head.find("\"schema\": \"toothprep-batch\"") != std::string::npos;
    std::error_code error;
    for (const char* name : {"batch.csv", "batch.json", "batch.h5", "index.html", "summary.csv"})
      if (!ours && fs::exists(fs::symlink_status(dir_ / name, error)))
        throw InputError((dir_ / name).string(), "",
                         "was not written by a batch, so it is not replaced",
                         "give another folder");
  }

  // ---- What may run

  // Marks an item and all that it needs.
  void mark(std::size_t i, std::vector<bool>& marked) const {
    std::vector<std::size_t> open = {i};
    while (!open.empty()) {
      const std::size_t at = open.back();
      open.pop_back();
      if (marked[at]) continue;
      marked[at] = true;
      open.insert(open.end(), m_.items[at].needs.begin(), m_.items[at].needs.end());
    }
  }

  // The items that failed, and those that need them, which were not run therefore.
  std::vector<bool> failed_before() const {
    const std::size_t n = m_.items.size();
    std::vector<std::vector<std::size_t>> needed_by(n);
    std::vector<std::size_t> open;
    for (std::size_t i = 0; i < n; ++i) {
      for (const std::size_t need : m_.items[i].needs) needed_by[need].push_back(i);
      const auto known = store_.last(i);
      if (known && known->failed) open.push_back(i);
    }
    std::vector<bool> found(n, false);
    while (!open.empty()) {
      const std::size_t i = open.back();
      open.pop_back();
      if (found[i]) continue;
      found[i] = true;
      open.insert(open.end(), needed_by[i].begin(), needed_by[i].end());
    }
    return found;
  }

  void select() {
    const std::size_t n = m_.items.size();
    const BatchSelection& s = o_.selection;
    selected_.assign(n, !o_.look);
    concerned_.assign(n, true);
    if (s.names) {
      const std::unordered_set<std::string> names(s.names->begin(), s.names->end());
      concerned_.assign(n, false);
      for (std::size_t i = 0; i < n; ++i) {
        selected_[i] = names.count(m_.items[i].name) > 0;
        if (selected_[i]) mark(i, concerned_);
      }
      if (o_.tables_of_all) concerned_.assign(n, true);
    }
    if (!s.only.empty() || s.failed) {
      std::vector<bool> wanted(n, false);
      const std::vector<bool> among = s.failed ? failed_before() : std::vector<bool>(n, true);
      bool any = false;
      for (std::size_t i = 0; i < n; ++i) {
        const std::string& name = m_.items[i].name;
        if (!s.only.empty() && fnmatch(s.only.c_str(), name.c_str(), 0) != 0) continue;
        any = true;
        if (among[i]) mark(i, wanted);
      }
      if (!any)
        throw InputError("--only", s.only, "matches no item's name", "names stand in batch.csv");
      for (std::size_t i = 0; i < n; ++i) selected_[i] = selected_[i] && wanted[i];
    }
  }

  // ---- The walk over the items, what is needed first

  void prepare_walk() {
    const std::size_t n = m_.items.size();
    select();
    state_.assign(n, State::kWaits);
    forced_.assign(n, false);
    open_.assign(n, 0);
    not_done_.assign(n, 0);
    needed_by_.assign(n, {});
    seconds_.assign(n, 0);
    memory_.assign(n, 0);
    for (std::size_t i = 0; i < n; ++i) {
      if (!concerned_[i]) continue;
      open_[i] = m_.items[i].needs.size();
      for (const std::size_t need : m_.items[i].needs) {
        needed_by_[need].push_back(i);
        ++not_done_[need];
      }
      if (open_[i] == 0) ready_.push(i);
      ++concerned_count_;
    }
  }

  void walk() {
    prepare_walk();
    std::vector<Running> running;
    const auto most = static_cast<std::size_t>(std::max(1, o_.at_once));
    while (!interrupted() && (!ready_.empty() || !running.empty() || !held_.empty())) {
      if (!ready_.empty() && running.size() < most) {
        const std::size_t i = ready_.top();
        ready_.pop();
        consider(i, running);
        continue;
      }
      bool any = false;
      for (std::size_t r = 0; r < running.size();) {
        if (still_runs(running[r])) {
          ++r;
          continue;
        }
        any = true;
        const Running ended = std::move(running[r]);
        running.erase(running.begin() + static_cast<std::ptrdiff_t>(r));
        end(ended);
      }
      if (!any && running.empty() && !held_.empty()) {
        // Another process has them: later.
        std::this_thread::sleep_for(std::chrono::milliseconds(500));
        for (const std::size_t i : held_) ready_.push(i);
        held_.clear();
      } else if (!any) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    }
    if (!interrupted()) return;
    stop(running);
    for (const Running& r : running) release(r.index);
    running.clear();
  }

  // Done, to be run, or neither.
  void consider(std::size_t i, std::vector<Running>& running) {
    const BatchItem& item = m_.items[i];
    for (const std::size_t need : item.needs) {
      if (state_[need] == State::kLeft) return settle(i, State::kLeft);
      if (state_[need] != State::kFailed) continue;
      odd_[i] = store_.row(i, {});
      odd_[i].status = "failed";
      odd_[i].reason = "needs '" + m_.items[need].name + "', which failed";
      return report(i, State::kFailed, "failed");
    }
    std::string identity;
    std::optional<LedgerEntry> known;
    try {
      identity = store_.identity_of(i);
      if (!forced_[i] && !(o_.redo && selected_[i])) known = store_.ended(i, identity);
    } catch (const Error& e) {  // an input that can't be read any more
      odd_[i] = store_.row(i, {});
      odd_[i].status = "failed";
      odd_[i].reason = e.what();
      return report(i, State::kFailed, "failed");
    }
    if (known && !known->failed) return found_done(i, *known);
    if (!selected_[i] && !forced_[i])
      return known ? report(i, State::kFailed, "failed before") : settle(i, State::kLeft);
    if (revive_needs(i)) return;
    if (o_.claims) {
      if (o_.claims->take(item.name) == Claims::Answer::kHeld) {
        held_.push_back(i);
        return;
      }
      // Its last owner may have ended it just before.
      known = store_.ended(i, identity, true);
      if (known && !known->failed) {
        o_.claims->release(item.name);
        return found_done(i, *known);
      }
    }
    ++run_;
    try {
      running.push_back(start(i, std::move(identity)));
      state_[i] = State::kRuns;
    } catch (const std::exception& e) {
      const auto part = part_of(i);
      put(i, part->path(), store_.identity_of(i), {e.what()});
    }
  }

  void found_done(std::size_t i, const LedgerEntry& known) {
    seconds_[i] = known.seconds;
    memory_[i] = known.memory;
    report(i, State::kDone, "was done");
  }

  // Items whose files are needed and were not kept run again. True if there are any.
  bool revive_needs(std::size_t i) {
    std::error_code error;
    std::size_t revived = 0;
    for (const std::size_t need : m_.items[i].needs) {
      const auto& inputs = m_.items[i].inputs;
      if (std::all_of(inputs.begin(), inputs.end(), [&](const BatchInput& input) {
            return input.item != need || fs::exists(store_.path_of(input), error);
          }))
        continue;
      ++revived;
      if (std::find(waiting_for_[need].begin(), waiting_for_[need].end(), i) ==
          waiting_for_[need].end())
        waiting_for_[need].push_back(i);
      if (forced_[need]) continue;  // it is on its way
      forced_[need] = true;
      --ended_;
      state_[need] = State::kWaits;
      ready_.push(need);
    }
    if (revived > 0) open_[i] = revived;
    return revived > 0;
  }

  std::unique_ptr<Part> part_of(std::size_t i) const {
    return std::make_unique<Part>(dir_, "", store_.folder_of(i).string(), true);
  }

  Running start(std::size_t i, std::string identity) const {
    const BatchItem& item = m_.items[i];
    const BatchCommand& command = m_.commands[item.command];
    Running r;
    r.index = i;
    r.identity = std::move(identity);
    r.part = part_of(i);
    store_.fill(i, r.part->path());
    const std::vector<std::string> line =
        item_command(m_, i, o_, [&](const BatchInput& input) { return store_.path_of(input); });
    const std::string folder = r.part->path(), log = folder + "/log.txt";
    r.start = Clock::now();
    r.child = std::make_unique<ChildProcess>(
        line, ChildOptions{folder,
                           command.result_on_stdout ? folder + "/" + command.result : log,
                           log,
                           true,
                           {},
                           o_.starter});
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

  void end(const Running& r) {
    const ChildEnd ended = r.child->end();
    const fs::path part = r.part->path();
    const std::string said = ItemStore::last_line(part / "log.txt");
    ItemEnd end{"", seconds_since(r.start), static_cast<double>(ended.memory)};
    if (o_.claims && !r.late && !ended.exited && ended.code == SIGKILL) {
      // On a cluster that is a lack of memory, or the end of the job: it may do better elsewhere.
      release(r.index);
      killed_.push_back(r.index);
      return settle(r.index, State::kLeft);
    }
    if (r.late) {
      end.reason = fmt::format("took longer than {:g} s", o_.time_limit);
    } else if (!ended.exited) {
      end.reason = std::string("ended by signal ") + std::to_string(ended.code) + " (" +
                   strsignal(ended.code) + ")" + (said.empty() ? "" : ": " + said);
    } else if (ended.code != 0) {
      end.reason = said.empty() ? "exit status " + std::to_string(ended.code) : said;
    }
    put(r.index, part, r.identity, end);
  }

  void put(std::size_t i, const fs::path& part, const std::string& identity, const ItemEnd& end) {
    seconds_[i] = end.seconds;
    memory_[i] = end.memory;
    const bool all = not_done_[i] > 0 || o_.claims;  // a dependant may need what isn't kept
    ItemRow row = store_.put(i, part, identity, end, all);
    release(i);
    const bool failed = row.failed();
    const std::string how = row.status;
    const auto entry = store_.last(i);
    if (!entry) odd_[i] = std::move(row);  // it could not be written
    if (entry && !failed) check_disk(i, *entry);
    report(i, failed ? State::kFailed : State::kDone, how);
  }

  // After the first item of each step or command: whether there is space for the others like it.
  void check_disk(std::size_t i, const LedgerEntry& entry) {
    const auto like = [&](std::size_t k) {
      return m_.items[k].step == m_.items[i].step && m_.items[k].command == m_.items[i].command;
    };
    if (!o_.warn || !measured_.emplace(m_.items[i].step, m_.items[i].command).second) return;
    double each = 0;
    for (const LedgerFile& file : entry.files)
      if (keeps(m_.items[i].keep, file.name))
        each += static_cast<double>(std::max<std::uint64_t>(file.size, 4096));
    std::size_t left = 0;
    for (std::size_t k = 0; k < m_.items.size(); ++k)
      left += k != i && like(k) && selected_[k] && state_[k] == State::kWaits;
    std::error_code error;
    const double free =
        o_.free_disk ? o_.free_disk() : static_cast<double>(fs::space(dir_, error).available);
    const double needed = each * static_cast<double>(left);
    if (error || needed <= free) return;
    o_.warn(fmt::format(
        "{}: {} more items like '{}' ({} each) need about {} on disk, {} are free; keep less of "
        "each (keep in the manifest), or end this and give another folder",
        o_.folder, left, m_.items[i].name, size_text(each), size_text(needed), size_text(free)));
  }

  void release(std::size_t i) const {
    if (o_.claims) o_.claims->release(m_.items[i].name);
  }

  void report(std::size_t i, State state, const std::string& how) {
    settle(i, state);
    if (!o_.progress) return;
    const std::string reason = how == "was done" && !o_.look ? std::string() : row(i).reason;
    o_.progress("[" + std::to_string(ended_) + "/" + std::to_string(concerned_count_) + "] " +
                m_.items[i].name + ": " + how + (reason.empty() ? "" : ": " + reason));
  }

  // An item has ended, or will not run: what waits for it is considered.
  void settle(std::size_t i, State state) {
    state_[i] = state;
    ++ended_;
    const auto wake = [&](std::size_t d) {
      if (--open_[d] == 0) ready_.push(d);
    };
    if (forced_[i]) {
      for (const std::size_t d : std::exchange(waiting_for_[i], {})) wake(d);
      return;
    }
    for (const std::size_t d : needed_by_[i]) wake(d);
    if (state != State::kDone || o_.look || o_.claims) return;
    // What is not kept stays until all that may read it is done.
    if (not_done_[i] == 0) drop(i);
    for (const std::size_t need : m_.items[i].needs)
      if (--not_done_[need] == 0) drop(need);
  }

  void drop(std::size_t i) {
    if (m_.items[i].keep == BatchKeep::kAll) return;
    try {
      store_.drop(i);
    } catch (const std::exception& e) {
      if (o_.progress)
        o_.progress(m_.items[i].name + ": what is not kept can't be removed: " + e.what());
    }
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

  // ---- What came of it

  ItemRow row(std::size_t i) const {
    if (const auto odd = odd_.find(i); odd != odd_.end()) return odd->second;
    const auto entry = store_.last(i, true);
    return store_.row(i, entry ? *entry : LedgerEntry{});
  }

  BatchResult result() {
    BatchResult done;
    done.run = run_;
    done.interrupted = stopped_;
    done.seconds = std::move(seconds_);
    done.memory = std::move(memory_);
    done.killed = std::move(killed_);
    std::vector<std::size_t> ended;
    for (std::size_t i = 0; i < m_.items.size(); ++i) {
      if (!concerned_[i]) continue;
      if (state_[i] == State::kDone || state_[i] == State::kFailed)
        ended.push_back(i);
      else
        done.left.push_back(i);
      done.failed += state_[i] == State::kFailed;
    }
    // The rows outlive this object: with what they are read from.
    auto ledger = std::make_shared<Ledger>(dir_, "local");
    ledger->load();
    auto store = std::make_shared<ItemStore>(m_, dir_, o_.version, o_.build, *ledger, true);
    const std::size_t count = ended.size();
    done.rows = ItemRows(count,
                         [ledger, store, manifest = manifest_, odd = odd_,
                          ended = std::move(ended)](std::size_t k) -> ItemRow {
                           if (const auto it = odd.find(ended[k]); it != odd.end())
                             return it->second;
                           const auto entry = store->last(ended[k], true);
                           return store->row(ended[k], entry ? *entry : LedgerEntry{});
                         });
    return done;
  }

  std::shared_ptr<const BatchManifest> manifest_;
  const BatchManifest& m_;
  const BatchOptions& o_;
  fs::path dir_;
  Ledger ledger_;
  ItemStore store_;
  bool stopped_ = false;
  std::size_t run_ = 0, ended_ = 0, concerned_count_ = 0;

  // By item.
  std::vector<bool> selected_, concerned_;  // may run; matters at all
  std::vector<bool> forced_;                // runs again for the files that were not kept
  std::vector<State> state_;
  std::vector<std::size_t> open_, not_done_;  // what it waits for; who may still read it
  std::vector<std::vector<std::size_t>> needed_by_;
  std::vector<double> seconds_, memory_;
  std::map<std::size_t, ItemRow> odd_;                           // rows that stand in no folder
  std::map<std::size_t, std::vector<std::size_t>> waiting_for_;  // of forced ones
  std::priority_queue<std::size_t, std::vector<std::size_t>, std::greater<>> ready_;
  std::vector<std::size_t> killed_;                         // at work, by something else
  std::vector<std::size_t> held_;                           // by another process
  std::set<std::pair<std::string, std::size_t>> measured_;  // steps and commands, for their disk
};

}  // namespace

BatchResult run_batch(BatchManifest manifest, const BatchOptions& options) {
  return Batch(std::make_shared<const BatchManifest>(std::move(manifest)), options).run();
}

}  // namespace toothprep
