#include "command.h"

namespace toothprep::app {
void add_specimen(CLI::App&, const Common&) {}
}  // namespace toothprep::app
