#include "toothprep/tools/io/folder_marker.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <vector>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/tools/io/part.h"
#include "toothprep/tools/io/write_file.h"

namespace toothprep {
namespace fs = std::filesystem;
namespace {

constexpr const char* kHead =
    "# Files that toothprep wrote. --force replaces this folder only while it holds just these,\n"
    "# unchanged. To check them: sha256sum -c .toothprep-folder\n";
constexpr std::size_t kHashLength = 64;

using Files = std::map<std::string, std::string>;  // name below the folder -> SHA-256

std::optional<Files> read_marker(const fs::path& folder) {
  std::error_code error;
  const fs::path path = folder / kFolderMarker;
  if (!fs::is_regular_file(fs::symlink_status(path, error))) return {};
  std::ifstream in(path, std::ios::binary);
  Files files;
  for (std::string line; std::getline(in, line);)
    if (line.size() > kHashLength + 2 && line[0] != '#')
      files[line.substr(kHashLength + 2)] = line.substr(0, kHashLength);
  return files;
}

// The names in a folder, sorted.
std::vector<std::string> names_in(const fs::path& folder) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder))
    if (!is_own_part(entry.path().filename().string()))
      names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

void list_files(const fs::path& folder, const std::string& below, std::string& text) {
  for (const std::string& name : names_in(folder / below)) {
    const std::string path = below + name;
    if (fs::is_directory(fs::symlink_status(folder / path)))
      list_files(folder, path + '/', text);
    else if (path != kFolderMarker)
      text += sha256_of_file((folder / path).string()) + "  " + path + '\n';
  }
}

// Of a folder with a marker. Enters only folders in which there should be files.
std::string first_foreign(const fs::path& folder, const std::string& below, const Files& files) {
  for (const std::string& name : names_in(folder / below)) {
    const std::string path = below + name;
    if (path == kFolderMarker) continue;
    const fs::file_status status = fs::symlink_status(folder / path);
    const auto known = files.find(path), inside_it = files.lower_bound(path + '/');
    if (fs::is_directory(status) && inside_it != files.end() &&
        inside_it->first.starts_with(path + '/')) {
      std::string inside = first_foreign(folder, path + '/', files);
      if (!inside.empty()) return inside;
    } else if (!fs::is_regular_file(status) || known == files.end()) {
      return "holds '" + path + "', which this program did not write";
    } else if (sha256_of_file((folder / path).string()) != known->second) {
      return "holds '" + path + "', which was changed since this program wrote it";
    }
  }
  return {};
}

}  // namespace

void mark_folder(const std::string& folder) {
  std::string text = kHead;
  list_files(folder, "", text);
  write_file((fs::path(folder) / kFolderMarker).string(), text);
}

std::string not_ours(const std::string& folder) {
  const auto names = names_in(folder);
  if (names.empty()) return {};
  const auto files = read_marker(folder);
  if (!files) return "holds '" + names.front() + "' and was not written by this program";
  return first_foreign(folder, "", *files);
}

}  // namespace toothprep
