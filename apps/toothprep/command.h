// What the subcommands share. One file per subcommand: its options and one library call.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>

namespace toothprep::app {

struct Common {
  bool quiet = false;
  int threads = 0;  // 0: all cores
};

// Adds a subcommand to the application; its callback does the work and throws toothprep::Error.
using AddCommand = void (*)(CLI::App& app, const Common& common);

void add_specimen(CLI::App& app, const Common& common);
void add_voxelize(CLI::App& app, const Common& common);
void add_info(CLI::App& app, const Common& common);
void add_replay(CLI::App& app, const Common& common);
void add_export(CLI::App& app, const Common& common);
void add_mesh(CLI::App& app, const Common& common);
void add_figures(CLI::App& app, const Common& common);

// A line of talk on stderr, unless --quiet.
void say(const Common& common, const std::string& line);
void warn(const std::string& line);  // "warning: ..." on stderr, also when quiet

// Folder of the shipped data (burs, trajectories): $TOOTHPREP_DATA, beside the sources, or
// installed.
std::string data_folder();
// Folder of the shipped scripts, beside the sources or installed with the data.
std::string script_folder();

}  // namespace toothprep::app
