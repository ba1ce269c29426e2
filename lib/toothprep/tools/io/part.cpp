#include "toothprep/tools/io/part.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <fstream>
#include <mutex>
#include <optional>
#include <sstream>
#include <system_error>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/tools/io/process_name.h"

namespace toothprep {
namespace fs = std::filesystem;

// Never freed, so that the handler may walk the list at any time.
struct PartEntry {
  std::string path, shown;
  std::atomic<bool> there{true};
  PartEntry* next = nullptr;
};

namespace {

constexpr const char* kPrefix = ".toothprep-part-";
constexpr int kDeepest = 16;  // folders in folders

std::atomic<PartEntry*> newest{nullptr};
std::atomic<int> waiting{0};  // SignalsWait objects
std::atomic<int> came{0};     // the signal that came meanwhile
pid_t owner = 0;              // a forked child has no parts

// What getdents64 gives.
struct DirectoryEntry {
  std::uint64_t inode;
  std::int64_t offset;
  unsigned short length;
  unsigned char type;
  char name[1];
};

// A file, or a folder with all that is in it. By system calls alone: it runs in a signal handler.
void remove_tree(int at, const char* name, int depth = 0) noexcept {
  if (unlinkat(at, name, 0) == 0 || (errno != EISDIR && errno != EPERM)) return;
  const int folder = openat(at, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
  if (folder < 0) return;
  for (int pass = 0; pass < 10; ++pass) {  // another thread may still write
    lseek(folder, 0, SEEK_SET);
    alignas(DirectoryEntry) char entries[2048];
    long bytes = 0;
    while (depth < kDeepest &&
           (bytes = syscall(SYS_getdents64, folder, entries, sizeof entries)) > 0)
      for (long i = 0; i < bytes;) {
        const auto* entry = reinterpret_cast<const DirectoryEntry*>(entries + i);
        i += entry->length;
        const char* n = entry->name;
        const bool dots = n[0] == '.' && (n[1] == 0 || (n[1] == '.' && n[2] == 0));
        if (!dots) remove_tree(folder, n, depth + 1);
      }
    if (unlinkat(at, name, AT_REMOVEDIR) == 0) break;
  }
  close(folder);
}

// ---- Whose a part is

std::string hex8(const std::string& text) {
  Sha256 hash;
  hash.update(text.data(), text.size());
  return hash.hex().substr(0, 8);
}

std::string first_line(const char* path) {
  std::ifstream in(path);
  std::string line;
  std::getline(in, line);
  return line;
}

// When the process started, in ticks since boot; nothing if it does not run.
std::optional<unsigned long long> start_of(long pid) {
  std::ifstream in("/proc/" + std::to_string(pid) + "/stat");
  std::string text;
  std::getline(in, text, '\0');
  const auto name_end = text.rfind(')');  // the name may hold anything
  if (name_end == std::string::npos) return {};
  std::istringstream fields(text.substr(name_end + 1));
  std::string field;
  for (int k = 3; k < 22; ++k) {
    if (!(fields >> field)) return {};
    if (k == 3 && (field == "Z" || field == "X")) return {};  // dead, not yet waited for
  }
  unsigned long long start = 0;
  return fields >> start ? std::optional(start) : std::nullopt;
}

struct Host {
  std::string machine;  // name, machine id, and the space of process ids
  std::string boot;
};

const Host& host() {
  static const Host here = [] {
    std::array<char, 256> name{};
    gethostname(name.data(), name.size() - 1);
    std::array<char, 64> pids{};
    if (readlink("/proc/self/ns/pid", pids.data(), pids.size() - 1) < 0) pids[0] = '?';
    return Host{
        hex8(std::string(name.data()) + '\n' + first_line("/etc/machine-id") + '\n' + pids.data()),
        hex8(first_line("/proc/sys/kernel/random/boot_id"))};
  }();
  return here;
}

bool is_stale(const std::string& name) {
  return name.rfind(kPrefix, 0) == 0 &&
         process_state(name.substr(std::strlen(kPrefix))) == ProcessState::kEnded;
}

std::string new_name(const std::string& extension) {
  static std::atomic<unsigned> serial{0};
  return kPrefix + process_name() + '-' + std::to_string(++serial) + extension;
}

// ---- Signals

constexpr std::array<int, 6> kSignals = {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGPIPE, SIGXCPU};

void remove_all_parts() noexcept {
  for (const PartEntry* e = newest.load(); e; e = e->next)
    if (e->there.load()) remove_tree(AT_FDCWD, e->path.c_str());
}

// The signal may be handled in one thread while another makes or reopens its part: no file is
// opened any more before the last look. The pause lets an open() end that had begun. By system
// calls alone: it runs in a signal handler.
void remove_all_parts_for_good() noexcept {
  remove_all_parts();  // folders, which need open files for it
  rlimit none{};
  if (getrlimit(RLIMIT_NOFILE, &none) == 0) {
    none.rlim_cur = 0;
    setrlimit(RLIMIT_NOFILE, &none);
  }
  const timespec pause{.tv_sec = 0, .tv_nsec = 5'000'000};
  nanosleep(&pause, nullptr);
  remove_all_parts();
}

// The disposition is the default again when this runs (SA_RESETHAND), so raise() ends the program.
void on_signal(int signal) {
  const int error = errno;
  if (getpid() == owner && waiting.load() > 0) {
    came.store(signal);
  } else {
    if (getpid() == owner) remove_all_parts_for_good();
    raise(signal);
  }
  errno = error;
}

// Signals that are ignored (nohup) or handled by somebody else stay so.
void handle_signals() {
  owner = getpid();
  for (const int signal : kSignals) {
    struct sigaction now {};
    if (sigaction(signal, nullptr, &now) != 0 || now.sa_handler != SIG_DFL) continue;
    struct sigaction own {};
    own.sa_handler = on_signal;
    own.sa_flags = static_cast<int>(SA_RESETHAND);
    sigfillset(&own.sa_mask);
    sigaction(signal, &own, nullptr);
  }
}

PartEntry* registered(std::string path, const std::string& shown) {
  auto* entry = new PartEntry;
  entry->path = std::move(path);
  entry->shown = shown;
  entry->next = newest.load();
  while (!newest.compare_exchange_weak(entry->next, entry)) {
  }
  return entry;
}

}  // namespace

std::string process_name() {
  return host().machine + '-' + host().boot + '-' + std::to_string(getpid()) + '-' +
         std::to_string(start_of(getpid()).value_or(0));
}

// What follows the name is of no matter.
ProcessState process_state(const std::string& name) {
  std::array<char, 9> machine{}, boot{};
  long pid = 0;
  unsigned long long start = 0;
  if (std::sscanf(name.c_str(), "%8[0-9a-f]-%8[0-9a-f]-%ld-%llu", machine.data(), boot.data(), &pid,
                  &start) != 4 ||
      host().machine != machine.data())
    return ProcessState::kUnknown;
  const bool runs = host().boot == boot.data() && start_of(pid) == start;
  return runs ? ProcessState::kRuns : ProcessState::kEnded;
}

void forget_parts() { newest.store(nullptr); }

Part::Part(const fs::path& folder, const std::string& extension, const std::string& shown,
           bool is_folder)
    : path_((folder / new_name(is_folder ? std::string() : extension)).string()),
      entry_(registered(path_, shown)) {
  handle_signals();
  int made = -1;
  if (is_folder) {
    made = mkdir(path_.c_str(), 0777);
  } else if ((made = open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666)) >= 0) {
    close(made);
  }
  if (made >= 0) return;
  const int error = errno;
  entry_->there = false;
  throw Error(shown + ": cannot be written in '" + folder.string() +
              "': " + std::generic_category().message(error));
}

Part::~Part() {
  remove_tree(AT_FDCWD, path_.c_str());
  entry_->there = false;
}

bool is_own_part(const std::string& name) {
  for (const PartEntry* e = newest.load(); e; e = e->next)
    if (e->there && fs::path(e->path).filename() == name) return true;
  return false;
}

void remove_stale_parts(const fs::path& folder) {
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error))
    if (is_stale(entry->path().filename().string())) remove_tree(AT_FDCWD, entry->path().c_str());
}

std::string with_shown_names(std::string text) {
  for (const PartEntry* e = newest.load(); e; e = e->next)
    for (std::size_t at = 0; (at = text.find(e->path, at)) != std::string::npos;
         at += e->shown.size())
      text.replace(at, e->path.size(), e->shown);
  return text;
}

SignalsWait::SignalsWait() { ++waiting; }

SignalsWait::~SignalsWait() {
  if (--waiting > 0) return;
  if (const int signal = came.exchange(0)) {
    remove_all_parts_for_good();
    raise(signal);
  }
}

}  // namespace toothprep
