// The toothprep binary: parses the command line, runs one subcommand, turns errors into one line.
#include <fcntl.h>
#include <signal.h>
#include <tbb/global_control.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <iostream>
#include <new>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <thread>

#include "command.h"
#include "numeric_options.h"
#include "program.h"
#include "toothprep/build_info.h"
#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/child_process.h"
#include "toothprep/tools/io/file_extension.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/part.h"
#include "toothprep/tools/io/plain_text.h"
#include "toothprep/version.h"
#include "wrong_usage.h"

namespace toothprep::app {
namespace {

std::string one_line(std::string text) {
  for (char& c : text)
    if (c == '\n' || c == '\r') c = ' ';
  return terminal_text(text);
}

}  // namespace

void say(const Common& common, const std::string& line) {
  if (!common.quiet) std::cerr << terminal_text(line) << '\n';
}
void warn(const std::string& line) { std::cerr << "warning: " << one_line(line) << '\n'; }

bool has_extension(const std::string& path, const std::string& extension) {
  return file_extension(path) == extension;
}

std::string data_folder() {
  namespace fs = std::filesystem;
  if (const char* given = std::getenv("TOOTHPREP_DATA")) return given;
  std::error_code error;
  const fs::path self = fs::read_symlink("/proc/self/exe", error);
  const fs::path folder = self.parent_path();
  if (fs::equivalent(folder, kBuildFolder, error)) return std::string(kSourceFolder) + "/data";
  return (folder / ".." / "share" / "toothprep").lexically_normal().string();
}

bool run_script(const std::string& name, const std::vector<std::string>& arguments) {
  namespace fs = std::filesystem;
  const fs::path data = data_folder();
  std::error_code error;
  const fs::path installed = data / "scripts";
  const std::string script =
      ((fs::is_directory(installed, error) ? installed : data / ".." / "scripts") / name)
          .lexically_normal()
          .string();
  std::vector<std::string> line = {script};
  line.insert(line.end(), arguments.begin(), arguments.end());
  try {
    return ChildProcess(line).wait().good();
  } catch (const Error&) {  // can't be started
    return false;
  }
}

namespace {

// What was built, of what: `--version --json`.
std::string version_json() {
  nlohmann::ordered_json j = {{"schema", "toothprep-version"}, {"schema_version", 1},
                              {"toothprep_version", kVersion}, {"build", build_text()},
                              {"build_type", kBuildType},      {"compiler", kCompiler}};
  j["commit"] = *kCommit ? nlohmann::ordered_json(kCommit) : nlohmann::ordered_json(nullptr);
  j["libraries"] = nlohmann::ordered_json::object();
  for (const auto& [name, version] : library_versions()) j["libraries"][name] = version;
  return json_text(j);
}

int run(int argc, char** argv) {
  const std::set<std::string> words(argv + 1, argv + argc);
  if (argc == 3 && words == std::set<std::string>{"--version", "--json"}) {
    std::cout << version_json();
    if (!std::cout.flush()) throw Error("stdout cannot be written");
    return 0;
  }
  CLI::App app{
      "toothprep: haptic tooth preparation, offline. Layered teeth from CT, replay of handpiece\n"
      "trajectories through the force, virtual-coupling and stall pipeline, traces and meshes.\n"
      "Example: toothprep specimen molar -o molar.vdb\n"
      "Files in data/: of the repository, or installed in share/toothprep (pages with working\n"
      "links in share/doc/toothprep). data/guide.md says which page is for which job."};
  app.set_version_flag("--version", std::string("toothprep ") + kVersion,
                       "Version; with --json also build and libraries");
  app.require_subcommand(1);
  app.fallthrough();
  Common common;
  app.add_flag("--quiet,-q", common.quiet, "Only warnings and errors on stderr");
  app.add_option("--threads", common.threads, "Threads for offline work (0: all cores)")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  for (const AddCommand add :
       {add_specimen, add_voxelize,  add_orient,    add_info,  add_import,  add_place,
        add_prepare,  add_replay,    add_export,    add_mesh,  add_figures, add_live,
        add_recover,  add_rig_check, add_calibrate, add_batch, add_render,  add_score,
        add_view,     add_help,      add_completion})
    add(app, common);
  check_numbers(app);
  std::optional<tbb::global_control> limit;
  app.parse_complete_callback([&] {
    if (common.threads > 0)
      limit.emplace(tbb::global_control::max_allowed_parallelism, common.threads);
  });
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    std::ostringstream out, error;
    if (!names_unknown_command(app) && app.exit(e, out, error) == 0) {  // --help, --version
      std::cout << out.str();
      return 0;
    }
    std::cerr << terminal_text(wrong_usage(app, e));
    return 2;
  }
  if (!std::cout.flush() || std::fflush(stdout) != 0) throw Error("stdout cannot be written");
  return 0;
}

}  // namespace

int run_program(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::bad_alloc&) {
    std::cerr << "toothprep: not enough memory for this input\n";
  } catch (const std::exception& e) {
    std::cerr << "toothprep: " << one_line(with_shown_names(e.what())) << '\n';
  } catch (...) {
    std::cerr << "toothprep: unknown failure\n";
  }
  return 1;
}

}  // namespace toothprep::app

// A file that is opened later must not become stderr: what is closed of 0, 1 and 2 is taken.
static void reserve_standard_descriptors() {
  for (int fd = 0; fd <= STDERR_FILENO; ++fd)
    if (fcntl(fd, F_GETFD) < 0 && errno == EBADF)
      static_cast<void>(open("/dev/null", fd == 0 ? O_RDONLY : O_WRONLY));
}

int main(int argc, char** argv) {
  reserve_standard_descriptors();
  signal(SIGXFSZ, SIG_IGN);  // a file that gets too large is an error, not the program's end
  return toothprep::app::run_program(argc, argv);
}
