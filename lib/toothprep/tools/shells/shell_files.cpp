#include <filesystem>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/tools/shells/shells.h"

namespace toothprep {
namespace {

std::string joined(const std::vector<std::string>& texts, const char* separator) {
  std::string all;
  for (const auto& text : texts) all += (all.empty() ? "" : separator) + text;
  return all;
}

// Without faults: mended if that is asked for.
Shell sound_shell(const std::string& path, bool repair, std::vector<std::string>& notes) {
  Shell shell = read_shell(path);
  std::vector<std::string> faults = shell_faults(shell);
  if (!faults.empty() && repair) {
    const auto repairs = repair_shell(shell);
    if (!repairs.empty()) notes.push_back(path + ": repaired: " + joined(repairs, "; "));
    faults = shell_faults(shell);
  }
  if (!faults.empty())
    throw InputError(path, "", joined(faults, "; "),
                     repair ? "this can't be repaired without guessing; do it in a mesh program"
                            : "--repair mends small faults");
  return shell;
}

}  // namespace

LayeredTooth voxelize_shell_files(const std::vector<std::pair<Tissue, std::string>>& files,
                                  bool repair, const ShellOptions& options,
                                  std::vector<std::string>& notes) {
  std::vector<TissueShell> shells;
  std::vector<std::string> names;
  Sha256 all;
  for (const auto& [tissue, file] : files) {
    if (options.progress) options.progress("reading and checking", 0);
    shells.push_back({tissue, sound_shell(file, repair, notes)});
    const std::string one = sha256_of_file(file);
    all.update(one.data(), one.size());
    names.push_back(std::filesystem::path(file).filename().string());
  }
  LayeredTooth tooth = voxelize_shells(shells, options, &notes);
  tooth.provenance["source"] = joined(names, ", ");
  tooth.provenance["source_sha256"] = all.hex();
  return tooth;
}

}  // namespace toothprep
