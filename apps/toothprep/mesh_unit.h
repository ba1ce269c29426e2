// The option --length-unit of commands that read meshes.
#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>

namespace toothprep::app {

void add_mesh_unit(CLI::App& sub, std::string& unit);

// None if the option was not given.
std::optional<double> mm_per_mesh_unit(const std::string& unit);

}  // namespace toothprep::app
