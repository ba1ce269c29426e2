#include "command.h"

namespace toothprep::app {
void add_export(CLI::App&, const Common&) {}
}  // namespace toothprep::app
