#include "command.h"

namespace toothprep::app {
void add_info(CLI::App&, const Common&) {}
}  // namespace toothprep::app
