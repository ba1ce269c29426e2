// A command's manual page for `man`, from the command line's own description.
#pragma once

#include <string>

#include "command_tree.h"

namespace toothprep::app {

// `root` is `toothprep` itself: its options hold for every command.
std::string man_page(const CommandFacts& command, const CommandFacts& root);

}  // namespace toothprep::app
