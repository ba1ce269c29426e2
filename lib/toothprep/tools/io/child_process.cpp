#include "toothprep/tools/io/child_process.h"

#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <iostream>
#include <mutex>
#include <system_error>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/part.h"

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

// Ends the child, without what its parent would do at its end.
[[noreturn]] void run_work(const ChildOptions& o, const std::vector<std::string>& arguments) {
  int status = 1;
  try {
    status = o.work(arguments);
  } catch (...) {  // it reports its errors itself
  }
  std::cout.flush();
  std::cerr.flush();
  if (std::fflush(nullptr) != 0 && status == 0) status = 1;
  _exit(status);
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

// ---- The starter

namespace {

// Sockets and pipes may take less than all at once. False at their end.
bool send_all(int to, const void* data, std::size_t size) {
  for (const auto* at = static_cast<const char*>(data); size > 0;) {
    const ssize_t n = send(to, at, size, MSG_NOSIGNAL);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    at += n;
    size -= static_cast<std::size_t>(n);
  }
  return true;
}

bool receive_all(int from, void* data, std::size_t size) {
  for (auto* at = static_cast<char*>(data); size > 0;) {
    const ssize_t n = read(from, at, size);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    at += n;
    size -= static_cast<std::size_t>(n);
  }
  return true;
}

struct Started {
  pid_t child = -1;
  int error = 0;
};

// Starts a child by `make_child` (fork or the like) and waits until it is at work. `parent`: of
// the child.
Started start_child(const std::vector<std::string>& arguments, const ChildOptions& options,
                    pid_t parent, pid_t (*make_child)()) {
  std::vector<char*> argv;
  for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
  argv.push_back(nullptr);
  int ends[2];  // closes when the program has started; else it carries why not
  if (pipe2(ends, O_CLOEXEC) != 0) return {-1, errno};
  Started started;
  started.child = make_child();
  if (started.child == 0) {
    end_with_parent(parent, SIGTERM);
    const bool ready = prepare(options);
    if (ready && options.work) {
      close(ends[1]);
      forget_parts();
      run_work(options, arguments);
    }
    if (ready) execv(argv[0], argv.data());
    const int error = errno;
    _exit(write(ends[1], &error, sizeof error) > 0 ? 127 : 126);
  }
  started.error = started.child < 0 ? errno : 0;
  close(ends[1]);
  while (started.child > 0 && read(ends[0], &started.error, sizeof started.error) < 0 &&
         errno == EINTR) {
  }
  close(ends[0]);
  return started;
}

// A child of this process's parent. Without the C library, whose fork() can't do that: it keeps
// this process's idea of the thread's number, which only locks within the child compare.
pid_t fork_sibling() {
  return static_cast<pid_t>(syscall(SYS_clone, CLONE_PARENT | SIGCHLD, 0, 0, 0, 0));
}

// The starter's process: until the program has ended.
[[noreturn]] void serve(int socket, const ChildOptions& common) {
  const pid_t parent = getppid();
  std::vector<std::string> texts;
  for (std::uint32_t count = 0; receive_all(socket, &count, sizeof count);) {
    texts.assign(count, {});
    for (std::string& text : texts) {
      std::uint64_t size = 0;
      if (!receive_all(socket, &size, sizeof size)) _exit(0);
      text.resize(size);
      if (!receive_all(socket, text.data(), size)) _exit(0);
    }
    ChildOptions options = common;
    options.folder = texts[0];
    options.stdout_file = texts[1];
    options.stderr_file = texts[2];
    const Started answer =
        start_child({texts.begin() + 3, texts.end()}, options, parent, fork_sibling);
    if (!send_all(socket, &answer, sizeof answer)) break;
  }
  _exit(0);
}

}  // namespace

ChildStarter::ChildStarter(std::function<int(const std::vector<std::string>&)> work) {
  std::array<int, 2> ends{};
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0)
    throw Error("no child can be started: " + std::generic_category().message(errno));
  const pid_t parent = getpid();
  // Signals to all are the program's matter (Ctrl-C, a cluster's time limit): what the program still
  // starts must not fail for want of a starter, from its first moment on. Its children take them.
  sigset_t to_all, before;
  sigemptyset(&to_all);
  for (const int s : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&to_all, s);
  pthread_sigmask(SIG_BLOCK, &to_all, &before);
  pid_ = fork_alone();
  if (pid_ == 0) {
    end_with_parent(parent, SIGKILL);
    setpgid(0, 0);
    for (const int s : {SIGINT, SIGTERM, SIGHUP}) signal(s, SIG_IGN);
    close(ends[0]);
    ChildOptions common;
    common.own_group = true;
    const int socket = ends[1];
    common.work = [socket, &work](const std::vector<std::string>& arguments) {
      close(socket);
      return work(arguments);
    };
    serve(socket, common);
  }
  const int error = errno;
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
  close(ends[1]);
  socket_ = ends[0];
  if (pid_ > 0) return;
  close(socket_);
  throw Error("no child can be started: " + std::generic_category().message(error));
}

ChildStarter::~ChildStarter() {
  close(socket_);  // it ends by that
  while (waitpid(pid_, nullptr, 0) < 0 && errno == EINTR) {
  }
}

ChildStarter::Answer ChildStarter::start(const std::vector<std::string>& arguments,
                                         const ChildOptions& options) {
  std::string request;
  const auto add = [&](const auto& value) {
    request.append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  const auto add_text = [&](const std::string& text) {
    add(std::uint64_t{text.size()});
    request += text;
  };
  add(static_cast<std::uint32_t>(arguments.size() + 3));
  for (const std::string* text : {&options.folder, &options.stdout_file, &options.stderr_file})
    add_text(*text);
  for (const std::string& argument : arguments) add_text(argument);
  Started started;
  if (!send_all(socket_, request.data(), request.size()) ||
      !receive_all(socket_, &started, sizeof started))
    return {-1, ECHILD};
  return {started.child, started.error};
}

// ---- The child

ChildProcess::ChildProcess(const std::vector<std::string>& arguments, const ChildOptions& options)
    : own_group_(options.own_group) {
  int error = 0;
  if (options.starter) {
    const ChildStarter::Answer answer = options.starter->start(arguments, options);
    pid_ = answer.child;
    error = answer.error;
  } else {
    const Started started = start_child(arguments, options, getpid(), fork_alone);
    pid_ = started.child;
    error = started.error;
  }
  running_ = pid_ > 0;
  if (error == 0) return;
  if (running_) wait();
  throw Error(arguments[0] + ": cannot be started: " + std::generic_category().message(error));
}

ChildProcess::~ChildProcess() {
  terminate(true);
  wait();
}

void ChildProcess::ended(pid_t child, int status, long peak_kb) {
  running_ = false;
  if (child == pid_ && WIFEXITED(status))
    end_ = {true, WEXITSTATUS(status)};
  else
    end_ = {false, child == pid_ ? WTERMSIG(status) : SIGKILL};
  if (child == pid_) end_.memory = static_cast<std::uint64_t>(peak_kb) * 1024;
}

bool ChildProcess::running() {
  if (!running_) return false;
  int status = 0;
  rusage used{};
  const pid_t child = wait4(pid_, &status, WNOHANG, &used);
  if (child == 0 || (child < 0 && errno == EINTR)) return true;
  ended(child, status, used.ru_maxrss);
  return false;
}

ChildEnd ChildProcess::wait() {
  while (running_) {
    int status = 0;
    rusage used{};
    const pid_t child = wait4(pid_, &status, 0, &used);
    if (child >= 0 || errno != EINTR) ended(child, status, used.ru_maxrss);
  }
  return end_;
}

void ChildProcess::terminate(bool at_once) {
  if (running_) kill(own_group_ ? -pid_ : pid_, at_once ? SIGKILL : SIGTERM);
}

}  // namespace toothprep
