#include "command.h"

namespace toothprep::app {
void add_replay(CLI::App&, const Common&) {}
}  // namespace toothprep::app
