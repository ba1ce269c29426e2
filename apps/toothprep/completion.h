// A shell's completion, from the command line's own description.
#pragma once

#include <string>

#include "command_tree.h"

namespace toothprep::app {

std::string completion_script(const std::string& shell, const CommandFacts& root);

}  // namespace toothprep::app
