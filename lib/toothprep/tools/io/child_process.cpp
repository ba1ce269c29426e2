#include "toothprep/tools/io/child_process.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <mutex>
#include <system_error>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

bool redirect(int to, const char* path, int flags) {
  const int file = open(path, flags | O_CLOEXEC, 0666);
  return file >= 0 && dup2(file, to) >= 0;
}

// In the child, where only what is safe in a signal handler may be called.
bool prepare(const ChildOptions& o) {
  if (o.own_group && (setpgid(0, 0) != 0 || !redirect(0, "/dev/null", O_RDONLY))) return false;
  constexpr int kWrite = O_WRONLY | O_CREAT | O_TRUNC;
  if (!o.stderr_file.empty() && !redirect(2, o.stderr_file.c_str(), kWrite | O_APPEND))
    return false;
  if (!o.stdout_file.empty() &&
      (o.stdout_file == o.stderr_file ? dup2(2, 1) < 0
                                      : !redirect(1, o.stdout_file.c_str(), kWrite)))
    return false;
  if (!o.folder.empty() && chdir(o.folder.c_str()) != 0) return false;
  // No signal blocked or ignored that isn't so by itself.
  if (o.own_group)
    for (const int s : {SIGINT, SIGTERM, SIGHUP}) signal(s, SIG_DFL);
  signal(SIGPIPE, SIG_DFL);
  sigset_t none;
  sigemptyset(&none);
  return sigprocmask(SIG_SETMASK, &none, nullptr) == 0;
}

}  // namespace

pid_t fork_alone() {
  static std::mutex one;
  const std::scoped_lock guard(one);
  return fork();
}

void end_with_parent(pid_t parent, int signal) {
  prctl(PR_SET_PDEATHSIG, signal);
  if (getppid() != parent) _exit(1);  // it ended before
}

ChildProcess::ChildProcess(const std::vector<std::string>& arguments, const ChildOptions& options)
    : own_group_(options.own_group) {
  std::vector<char*> argv;
  for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
  argv.push_back(nullptr);
  int ends[2];  // closes when the program has started; else it carries why not
  if (pipe2(ends, O_CLOEXEC) != 0)
    throw Error(arguments[0] + ": cannot be started: " + std::generic_category().message(errno));
  const pid_t parent = getpid();
  pid_ = fork_alone();
  if (pid_ == 0) {
    end_with_parent(parent, SIGTERM);
    if (prepare(options)) execv(argv[0], argv.data());
    const int error = errno;
    _exit(write(ends[1], &error, sizeof error) > 0 ? 127 : 126);
  }
  int error = pid_ < 0 ? errno : 0;
  close(ends[1]);
  while (pid_ > 0 && read(ends[0], &error, sizeof error) < 0 && errno == EINTR) {
  }
  close(ends[0]);
  running_ = pid_ > 0;
  if (error == 0) return;
  if (running_) wait();
  throw Error(arguments[0] + ": cannot be started: " + std::generic_category().message(error));
}

ChildProcess::~ChildProcess() {
  terminate(true);
  wait();
}

void ChildProcess::ended(pid_t child, int status) {
  running_ = false;
  if (child == pid_ && WIFEXITED(status))
    end_ = {true, WEXITSTATUS(status)};
  else
    end_ = {false, child == pid_ ? WTERMSIG(status) : SIGKILL};
}

bool ChildProcess::running() {
  if (!running_) return false;
  int status = 0;
  const pid_t child = waitpid(pid_, &status, WNOHANG);
  if (child == 0 || (child < 0 && errno == EINTR)) return true;
  ended(child, status);
  return false;
}

ChildEnd ChildProcess::wait() {
  while (running_) {
    int status = 0;
    const pid_t child = waitpid(pid_, &status, 0);
    if (child >= 0 || errno != EINTR) ended(child, status);
  }
  return end_;
}

void ChildProcess::terminate(bool at_once) {
  if (running_) kill(own_group_ ? -pid_ : pid_, at_once ? SIGKILL : SIGTERM);
}

}  // namespace toothprep
