#include "toothprep/tools/io/output_file.h"

#include <unistd.h>

#include <filesystem>
#include <system_error>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace fs = std::filesystem;

namespace {

// The first entry of a folder that is no plain file, nor one of its folders of plain files where
// those are allowed.
std::string first_unexpected(const fs::path& folder, bool folders_too) {
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.is_regular_file() && !entry.is_symlink()) continue;
    const std::string name = entry.path().filename().string();
    if (!folders_too || !entry.is_directory() || entry.is_symlink()) return name;
    const std::string inside = first_unexpected(entry.path(), false);
    if (!inside.empty()) return name + "/" + inside;
  }
  return {};
}

}  // namespace

OutputFile::OutputFile(std::string path, bool force, bool directory, const std::string& marker)
    : path_(std::move(path)), directory_(directory) {
  while (path_.size() > 1 && path_.back() == '/') path_.pop_back();
  std::error_code error;
  const fs::path target(path_);
  if (path_.empty() || target.filename().empty())
    throw Error("an output needs a file name, got '" + path_ + "'");
  if (fs::exists(target, error) && !force)
    throw Error(path_ + ": exists already; give --force to replace it");
  if (fs::is_directory(target, error) != directory_ && fs::exists(target, error))
    throw Error(path_ + (directory_ ? ": is a file; a folder is to be written here"
                                    : ": is a folder; a file is to be written here"));
  // Replacing a folder removes what is in it: only what looks like such an output goes, so that a
  // home or a project named by mistake stays.
  if (directory_ && fs::is_directory(target, error)) {
    const bool marked = !marker.empty() && fs::is_regular_file(target / marker, error);
    const std::string unexpected = first_unexpected(target, marked);
    if (!unexpected.empty())
      throw Error(path_ + ": holds '" + unexpected +
                  "', which is no plain file; remove the folder by hand or choose another");
  }
  const fs::path folder = target.has_parent_path() ? target.parent_path() : fs::path(".");
  if (!fs::is_directory(folder, error))
    throw Error(path_ + ": the folder '" + folder.string() + "' does not exist; create it first");
  if (access(folder.c_str(), W_OK) != 0)
    throw Error(path_ + ": the folder '" + folder.string() + "' can't be written");
  temporary_ = (folder / ("." + target.stem().string() + ".part" + std::to_string(getpid()) +
                          target.extension().string()))
                   .string();
  fs::remove_all(temporary_, error);
  if (directory_) fs::create_directory(temporary_);
}

OutputFile::~OutputFile() {
  std::error_code error;
  if (!committed_) fs::remove_all(temporary_, error);
}

void OutputFile::commit() {
  std::error_code error;
  if (directory_) fs::remove_all(path_, error);
  fs::rename(temporary_, path_, error);
  if (error) throw Error(path_ + ": cannot be written: " + error.message());
  committed_ = true;
}

}  // namespace toothprep
