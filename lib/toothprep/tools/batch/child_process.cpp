#include "toothprep/tools/batch/child_process.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "toothprep/step/core/errors.h"

extern char** environ;

namespace toothprep {

ChildProcess::ChildProcess(const std::vector<std::string>& arguments, const std::string& folder,
                           const std::string& stdout_file, const std::string& stderr_file) {
  std::vector<char*> argv;
  for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
  argv.push_back(nullptr);
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  constexpr int kWrite = O_WRONLY | O_CREAT | O_TRUNC;
  posix_spawn_file_actions_addopen(&files, 0, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&files, 2, stderr_file.c_str(), kWrite | O_APPEND, 0666);
  if (stdout_file == stderr_file)
    posix_spawn_file_actions_adddup2(&files, 2, 1);
  else
    posix_spawn_file_actions_addopen(&files, 1, stdout_file.c_str(), kWrite, 0666);
  posix_spawn_file_actions_addchdir_np(&files, folder.c_str());
  // A group of its own: Ctrl-C goes to the batch alone, which then ends its children in order. And
  // no signal blocked or ignored that isn't so by itself.
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  sigset_t none, all;
  sigemptyset(&none);
  sigemptyset(&all);
  for (const int s : {SIGINT, SIGTERM, SIGHUP, SIGPIPE}) sigaddset(&all, s);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setsigdefault(&attributes, &all);
  posix_spawnattr_setpgroup(&attributes, 0);
  posix_spawnattr_setflags(&attributes,
                           POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  const int error =
      posix_spawn(&pid_, arguments[0].c_str(), &files, &attributes, argv.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&files);
  if (error != 0) throw Error(arguments[0] + ": cannot be started: " + std::strerror(error));
  running_ = true;
}

ChildProcess::~ChildProcess() {
  if (!running_) return;
  terminate(true);
  while (waitpid(pid_, nullptr, 0) < 0 && errno == EINTR) {
  }
}

bool ChildProcess::running() {
  if (!running_) return false;
  int status = 0;
  const pid_t ended = waitpid(pid_, &status, WNOHANG);
  if (ended == 0 || (ended < 0 && errno == EINTR)) return true;
  running_ = false;
  if (ended == pid_ && WIFEXITED(status))
    end_ = {true, WEXITSTATUS(status)};
  else
    end_ = {false, ended == pid_ ? WTERMSIG(status) : SIGKILL};
  return false;
}

void ChildProcess::terminate(bool at_once) {
  if (running_) kill(-pid_, at_once ? SIGKILL : SIGTERM);
}

}  // namespace toothprep
