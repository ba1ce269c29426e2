#include "command.h"

namespace toothprep::app {
void add_voxelize(CLI::App&, const Common&) {}
}  // namespace toothprep::app
