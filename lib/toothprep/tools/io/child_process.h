// A program run as a child, without a shell. It ends (SIGTERM) when this program ends, however that
// happens.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace toothprep {

// fork(), by one thread at a time: libraries that end and restart their threads around it rely on
// that.
pid_t fork_alone();

// In a forked child: `signal` ends it when its parent, which is `parent`, has ended.
void end_with_parent(pid_t parent, int signal);

// Forks children in place of this program. A fork copies the tables of all memory that its process
// has, so children of a program that holds a large study start slowly; the starter is forked while
// the program is small, and stays so. Its children are the program's own: it waits for them, and
// they end with it. Make it before other threads run and before much is read.
class ChildStarter {
 public:
  // `work`: what the children do, with their arguments; the exit status. Throws Error.
  explicit ChildStarter(std::function<int(const std::vector<std::string>&)> work);
  ~ChildStarter();
  ChildStarter(const ChildStarter&) = delete;
  ChildStarter& operator=(const ChildStarter&) = delete;

 private:
  friend class ChildProcess;
  struct Answer {
    pid_t child = -1;
    int error = 0;  // why it did not start
  };
  // By the arguments and the options' folder and files.
  Answer start(const std::vector<std::string>& arguments, const struct ChildOptions& options);

  pid_t pid_ = -1;
  int socket_ = -1;
};

struct ChildOptions {
  std::string folder;                    // where it runs; empty: here
  std::string stdout_file, stderr_file;  // created; empty: this program's
  // Ctrl-C goes to this program alone, which then ends its children in order; stdin is empty.
  bool own_group = false;
  // In place of another program: what the child does, with the arguments; its exit status. For a
  // program without threads at that moment: the child has none of them.
  std::function<int(const std::vector<std::string>&)> work = {};
  ChildStarter* starter = nullptr;  // forks the child, which does the starter's work; own_group
};

struct ChildEnd {
  bool exited = false;       // else it was killed by a signal
  int code = 0;              // exit status, or the signal
  std::uint64_t memory = 0;  // bytes that it had at most
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
  void ended(pid_t child, int status, long peak_kb);

  pid_t pid_ = -1;
  bool own_group_ = false, running_ = false;
  ChildEnd end_;
};

}  // namespace toothprep
