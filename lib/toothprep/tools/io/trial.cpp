#include "toothprep/tools/io/trial.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/time.h>
#include <sys/wait.h>
#define TBB_PREVIEW_WAITING_FOR_WORKERS 1  // before oneTBB 2021.6
#include <tbb/global_control.h>
#include <tbb/version.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <exception>
#include <fstream>
#include <new>

#include "toothprep/tools/io/child_process.h"

namespace toothprep {
namespace {

constexpr int kThrew = 1, kCrashed = 2, kThrewInputError = 3;

bool in_trial = false;  // of a child

std::size_t memory_at_start = 0;  // bytes of address space that a child began with

void limit_memory(std::size_t more) {
#if defined(TOOTHPREP_SANITIZED)
  return;  // the sanitizer's own address space is beyond any limit
#endif
  rlimit address_space{};
  if (memory_at_start == 0 || getrlimit(RLIMIT_AS, &address_space) != 0) return;
  address_space.rlim_cur = std::min<rlim_t>(memory_at_start + more, address_space.rlim_max);
  setrlimit(RLIMIT_AS, &address_space);
}

// A child has a copy of TBB's state and none of its threads: a lock that one of them holds at the
// moment of the fork is held for ever, and work in the child waits for it. So they end first; the
// next parallel loop starts them again (0.2 ms). Not possible within a parallel loop.
void end_worker_threads() {
#if TBB_INTERFACE_VERSION >= 12060
  tbb::task_scheduler_handle workers{tbb::attach{}};
#else
  tbb::task_scheduler_handle workers = tbb::task_scheduler_handle::get();
#endif
  static_cast<void>(tbb::finalize(workers, std::nothrow));
}

[[noreturn]] void end_with_report(int report, const std::string& text, int status) {
  _exit(write(report, text.data(), text.size()) > 0 ? status : kCrashed);
}

// The parts of an InputError, each with a zero byte behind it; and back.
std::string parts_of(const InputError& e) {
  std::string text;
  for (const std::string& part : {e.file(), e.place(), e.condition(), e.remedy()})
    text += std::string(part.c_str()) + '\0';
  return text;
}
TrialFailure input_failure(const std::string& text) {
  std::array<std::string, 4> parts;
  std::size_t at = 0;
  for (std::string& part : parts) {
    const std::size_t end = text.find('\0', at);
    if (end == std::string::npos) return {};  // cut off
    part = text.substr(at, end - at);
    at = end + 1;
  }
  const InputError error(parts[0], parts[1], parts[2], parts[3]);
  return {error.what(), error};
}

[[noreturn]] void run_as_child(const std::function<void()>& work, unsigned seconds,
                               std::size_t memory, int report) {
  in_trial = true;
  std::size_t pages = 0;
  if (std::ifstream("/proc/self/statm") >> pages)
    memory_at_start = pages * static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  for (const int signal : {SIGSEGV, SIGBUS, SIGABRT, SIGFPE, SIGALRM, SIGPROF})
    std::signal(signal, SIG_DFL);
  const rlimit no_core{0, 0};
  setrlimit(RLIMIT_CORE, &no_core);
  limit_memory(memory);
  const int nowhere = open("/dev/null", O_WRONLY);  // "free(): invalid pointer" and the like
  if (nowhere >= 0) {
    dup2(nowhere, STDOUT_FILENO);
    dup2(nowhere, STDERR_FILENO);
  }
  alarm(seconds);
  try {
    work();
  } catch (const std::bad_alloc&) {
    _exit(kCrashed);
  } catch (const InputError& e) {
    end_with_report(report, parts_of(e), kThrewInputError);
  } catch (const std::exception& e) {
    end_with_report(report, e.what(), kThrew);
  } catch (...) {
    _exit(kCrashed);
  }
  _exit(0);
}

}  // namespace

std::optional<TrialFailure> failure_in_trial(const std::function<void()>& work, unsigned seconds,
                                             std::size_t memory) {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) return {};
  end_worker_threads();
  const pid_t parent = getpid(), child = fork_alone();
  if (child == 0) {
    end_with_parent(parent, SIGKILL);
    run_as_child(work, seconds, memory, ends[1]);
  }
  close(ends[1]);
  std::string text;
  char buffer[1024];
  for (ssize_t n = 0;
       child > 0 && ((n = read(ends[0], buffer, sizeof buffer)) > 0 || (n < 0 && errno == EINTR));)
    if (n > 0) text.append(buffer, static_cast<std::size_t>(n));
  close(ends[0]);
  int status = 0;
  if (child < 0) return {};
  while (waitpid(child, &status, 0) < 0)
    if (errno != EINTR) return {};
  const int end = WIFEXITED(status) ? WEXITSTATUS(status) : kCrashed;
  if (end == 0) return {};
  if (end == kThrewInputError) return input_failure(text);
  return TrialFailure{end == kThrew ? text : std::string(), {}};
}

void limit_trial(double cpu_seconds, std::size_t memory) {
  if (!in_trial) return;
  limit_memory(memory);
  itimerval timer{};
  timer.it_value.tv_sec = static_cast<time_t>(cpu_seconds);
  timer.it_value.tv_usec = static_cast<suseconds_t>(std::fmod(cpu_seconds, 1) * 1e6);
  setitimer(ITIMER_PROF, &timer, nullptr);
}

SharedMemory::SharedMemory(std::size_t bytes)
    : bytes_(bytes),
      at_(mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0)) {
  if (at_ == MAP_FAILED) throw std::bad_alloc();
}

SharedMemory::~SharedMemory() { munmap(at_, bytes_); }

}  // namespace toothprep
