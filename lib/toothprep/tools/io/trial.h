// Trying something that may crash, hang or take all memory, without doing so.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>

#include "toothprep/step/core/errors.h"

namespace toothprep {

// How a trial ended that didn't come to its end.
struct TrialFailure {
  std::string text;  // what() of the std::exception; empty if it crashed or took too much
  std::optional<InputError> input;  // the exception itself, if it was one of these
};

// Runs `work` in a child process, whose results are lost but for what it writes to SharedMemory.
// Gives nothing if it came to its end, and a failure if it threw, crashed, or took more than
// `seconds` or more than `memory` bytes. Nothing, too, if no child can be made. No other thread may
// hold a lock that `work` takes. May be called by several threads.
std::optional<TrialFailure> failure_in_trial(const std::function<void()>& work, unsigned seconds,
                                             std::size_t memory);

// Limits `work` anew, from here on: this much CPU time (not the wait for a slow disk) and memory. For
// work that finds out as it goes how much it may need. Does nothing outside a trial.
void limit_trial(double cpu_seconds, std::size_t memory);

// Memory that a child process can write for its parent; zero at first. Throws std::bad_alloc.
class SharedMemory {
 public:
  explicit SharedMemory(std::size_t bytes);
  ~SharedMemory();
  SharedMemory(const SharedMemory&) = delete;
  SharedMemory& operator=(const SharedMemory&) = delete;
  char* data() const { return static_cast<char*>(at_); }

 private:
  std::size_t bytes_;
  void* at_;
};

}  // namespace toothprep
