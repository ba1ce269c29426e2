// What this build was made of: for a program's --version and for the results that it writes. The program and the
// Python module have it; the installed libraries don't.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace toothprep {

extern const char* const kBuildType;  // "Release"
extern const char* const kCompiler;   // "GNU 12.2.0"
extern const char* const
    kCommit;  // of the source tree as it was configured; "-dirty": with changes; may be empty
extern const char* const kBuildFolder;   // where a program that isn't installed lies
extern const char* const kSourceFolder;  // and where its data lies

// "Release, GNU 12.2.0, 24ee6553c231"
std::string build_text();

// The libraries that it was compiled against, by name: ("Eigen3", "3.4.0"), ...
std::vector<std::pair<std::string, std::string>> library_versions();

}  // namespace toothprep
