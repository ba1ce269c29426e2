// How far a command is, on one line of a terminal.
#pragma once

#include <functional>
#include <mutex>
#include <string>

#include "command.h"

namespace toothprep::app {

class ProgressLine {
 public:
  explicit ProgressLine(const Common& common);  // writes nothing if stderr is no terminal
  ~ProgressLine();                              // leaves an empty line for what follows
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  // To be called with what is being done and the share of the whole (0..1), by any thread, while
  // this exists. Empty if nothing would be written.
  std::function<void(const std::string& stage, double done)> report();

 private:
  void write(const std::string& stage, double done);
  void erase();

  bool terminal_;
  std::mutex mutex_;
  std::string shown_;
};

}  // namespace toothprep::app
