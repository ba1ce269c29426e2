// By which a file's name says its format.
#pragma once

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <string>

namespace toothprep {

// The last extension of a path in lower case: ".ply" of "a/B.PLY", "" of "a".
[[nodiscard]] inline std::string file_extension(const std::string& path) {
  std::string extension = std::filesystem::path(path).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

}  // namespace toothprep
