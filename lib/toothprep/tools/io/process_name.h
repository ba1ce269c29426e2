// A process by a name that means the same on every machine: host, boot, process id and start.
#pragma once

#include <string>

namespace toothprep {

// Of this process.
std::string process_name();

enum class ProcessState {
  kRuns,
  kEnded,
  kUnknown  // it belongs to another machine, or it is no such name
};
ProcessState process_state(const std::string& name);

}  // namespace toothprep
