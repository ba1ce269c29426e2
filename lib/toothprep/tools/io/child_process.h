// A program run as a child, without a shell. It ends (SIGTERM) when this program ends, however that
// happens.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace toothprep {

// fork(), by one thread at a time: libraries that end and restart their threads around it rely on
// that.
pid_t fork_alone();

// In a forked child: `signal` ends it when its parent, which is `parent`, has ended.
void end_with_parent(pid_t parent, int signal);

struct ChildOptions {
  std::string folder;                    // where it runs; empty: here
  std::string stdout_file, stderr_file;  // created; empty: this program's
  // Ctrl-C goes to this program alone, which then ends its children in order; stdin is empty.
  bool own_group = false;
};

struct ChildEnd {
  bool exited = false;  // else it was killed by a signal
  int code = 0;         // exit status, or the signal
  bool good() const { return exited && code == 0; }
};

// Not copied; the destructor kills a child that still runs and waits for it.
class ChildProcess {
 public:
  // Starts `arguments` (the first is the program's path). Throws Error.
  explicit ChildProcess(const std::vector<std::string>& arguments,
                        const ChildOptions& options = {});
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  bool running();                        // polls
  ChildEnd wait();                       // for its end
  ChildEnd end() const { return end_; }  // once it no longer runs
  void terminate(bool at_once);          // SIGTERM, or SIGKILL, to it and its own children

 private:
  void ended(pid_t child, int status);

  pid_t pid_ = -1;
  bool own_group_ = false, running_ = false;
  ChildEnd end_;
};

}  // namespace toothprep
