// One check for every number on the command line.
#pragma once

#include <CLI/CLI.hpp>

namespace toothprep::app {

// Makes every option that takes numbers, of `app` and of all its subcommands, refuse what isn't a
// finite decimal number: nan (which passes any range), inf, 1e400, 0x10, and 010 for an integer.
// Call it when all options are there.
void check_numbers(CLI::App& app);

// An option of which inf means something.
CLI::Option* or_infinity(CLI::Option* option);

}  // namespace toothprep::app
