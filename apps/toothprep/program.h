// The whole program as a function.
#pragma once

namespace toothprep::app {

// Parses the line, runs its command, reports errors on stderr; the exit status.
int run_program(int argc, char** argv);

}  // namespace toothprep::app
