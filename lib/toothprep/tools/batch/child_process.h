// A program run as a child: its output in files, its own process group, no shell.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace toothprep {

struct ChildEnd {
  bool exited = false;  // else it was killed by a signal
  int code = 0;         // exit status, or the signal
};

// Not copied; the destructor kills a child that still runs and waits for it.
class ChildProcess {
 public:
  // Starts `arguments` (the first is the program's path) in `folder`, stdin empty, stdout and
  // stderr into files that are created. If both are the same file it gets both. Throws Error.
  ChildProcess(const std::vector<std::string>& arguments, const std::string& folder,
               const std::string& stdout_file, const std::string& stderr_file);
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  bool running();                        // polls
  ChildEnd end() const { return end_; }  // once it no longer runs
  void terminate(bool at_once);          // SIGTERM, or SIGKILL, to it and its own children

 private:
  pid_t pid_ = -1;
  bool running_ = false;
  ChildEnd end_;
};

}  // namespace toothprep
