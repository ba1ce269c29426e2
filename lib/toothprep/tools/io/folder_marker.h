// What shows that the program wrote a folder, and all that is in it.
#pragma once

#include <string>

namespace toothprep {

// The marker's name: a list of the folder's files with their SHA-256, as sha256sum writes them.
inline constexpr const char* kFolderMarker = ".toothprep-folder";

// Writes the marker of all that is in the folder. Throws Error.
void mark_folder(const std::string& folder);

// Why the folder can't be replaced: the first thing in it that the marker doesn't list, or that was
// changed since. Empty if all of it is ours, or nothing is in it.
std::string not_ours(const std::string& folder);

}  // namespace toothprep
