// Burs by shorthand (`cylinder:D1.2xL3.0`, `ball:D1.2`, ...), by a name of the library (data/burs), or
// from a profile file.
#pragma once

#include <string>
#include <vector>

#include "toothprep/bur/bur.h"

namespace toothprep {

// Resolves a --bur argument. Throws Error that says what was not understood and what would be.
// `library_folder` is data/burs, found by the application.
Bur make_bur(const std::string& spec, const std::string& library_folder);

struct LibraryEntry {
  std::string name;         // e.g. "837-012"
  std::string description;  // shape, ISO 6360 shape number, dimensions in mm
  std::string source;       // where each dimension comes from
};
std::vector<LibraryEntry> list_library(const std::string& library_folder);

}  // namespace toothprep
