#include "command.h"

namespace toothprep::app {
void add_mesh(CLI::App&, const Common&) {}
}  // namespace toothprep::app
