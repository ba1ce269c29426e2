// What the subcommands share. One file per subcommand: its options and one library call.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <vector>

namespace toothprep::app {

struct Common {
  bool quiet = false;
  int threads = 0;  // 0: all cores
};

// Adds a subcommand to the application; its callback does the work and throws toothprep::Error.
using AddCommand = void (*)(CLI::App& app, const Common& common);

void add_specimen(CLI::App& app, const Common& common);
void add_voxelize(CLI::App& app, const Common& common);
void add_orient(CLI::App& app, const Common& common);
void add_place(CLI::App& app, const Common& common);
void add_prepare(CLI::App& app, const Common& common);
void add_info(CLI::App& app, const Common& common);
void add_replay(CLI::App& app, const Common& common);
void add_import(CLI::App& app, const Common& common);
void add_export(CLI::App& app, const Common& common);
void add_mesh(CLI::App& app, const Common& common);
void add_figures(CLI::App& app, const Common& common);
void add_rig_check(CLI::App& app, const Common& common);
void add_live(CLI::App& app, const Common& common);
void add_recover(CLI::App& app, const Common& common);
void add_calibrate(CLI::App& app, const Common& common);
void add_batch(CLI::App& app, const Common& common);
void add_render(CLI::App& app, const Common& common);
void add_score(CLI::App& app, const Common& common);
void add_view(CLI::App& app, const Common& common);
void add_help(CLI::App& app, const Common& common);
void add_completion(CLI::App& app, const Common& common);
// Under `specimen`.
void add_measurement(CLI::App& specimen, const Common& common);
void add_cavity(CLI::App& specimen, const Common& common);

// A line of talk on stderr, unless --quiet.
void say(const Common& common, const std::string& line);
void warn(const std::string& line);  // "warning: ..." on stderr, also when quiet

bool has_extension(const std::string& path, const std::string& extension);  // ".ply", any case

// Folder of the shipped data (burs, trajectories): $TOOTHPREP_DATA; of a program in its build
// folder, that of the sources; else ../share/toothprep beside the program's own folder.
std::string data_folder();
// Runs a shipped script (beside the sources, or installed with the data) and waits for it; false if
// it can't be run or fails.
bool run_script(const std::string& name, const std::vector<std::string>& arguments);

}  // namespace toothprep::app
