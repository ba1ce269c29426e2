// What a mistyped command or option is answered with.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace toothprep::app {

// "no command 'repaly'; did you mean 'replay'?": `name` is none of the commands under `parent`.
std::string unknown_command(const CLI::App& parent, const std::string& name);

// What was wrong with the command line that `app` refused with `error`: the first word that is no
// command or option, with the nearest one that is, or else the parser's words.
std::string wrong_usage(const CLI::App& app, const CLI::ParseError& error);

// Whether the command line names a command that there isn't.
bool names_unknown_command(const CLI::App& app);

}  // namespace toothprep::app
