// Lines to stderr that never hold up who writes them: a thread of its own writes, and whoever
// doesn't read his terminal, or closed it, waits alone.
#pragma once

#include <memory>
#include <string>

namespace toothprep::app {

class Talk {
 public:
  Talk();
  // Waits half a second for what is still to be written, and drops the rest.
  ~Talk();
  Talk(const Talk&) = delete;
  Talk& operator=(const Talk&) = delete;

  void line(const std::string& text);
  // Overwrites the last status on a terminal; one that was not written yet is dropped.
  void status(const std::string& text);

 private:
  struct Shared;
  std::shared_ptr<Shared> shared_;  // the thread may outlive this
};

}  // namespace toothprep::app
