// Burs by shorthand (`cylinder:D1.2xL3.0`, `ball:D1.2`, ...: bur_shapes.h), by a name of the
// library (data/burs/library.toml), or from a profile file. The three formats are described in
// data/burs/README.md.
//
// An outline that stops at its highest point is closed by a disc there. That disc doesn't grind,
// nor does any piece with grinds = false.
#pragma once

#include <string>
#include <vector>

#include "toothprep/step/bur/bur.h"

namespace toothprep {

// Resolves a --bur argument. Throws Error that says what was not understood and what would be.
// `library_folder` is data/burs, found by the application.
[[nodiscard]] Bur make_bur(const std::string& spec, const std::string& library_folder);

// Reads a profile file. Throws InputError naming file, key and condition.
[[nodiscard]] Bur read_bur_file(const std::string& path);

struct LibraryEntry {       // one [[bur]] of library.toml
  std::string name;         // e.g. "837-012"
  std::string also;         // another name it goes by, e.g. "round-1/4"; may be empty
  std::string shape;        // its shorthand
  std::string description;  // what it is
  std::string source;       // where each dimension comes from
};
// In the order of the file. Throws InputError if it can't be read or an entry is incomplete.
[[nodiscard]] std::vector<LibraryEntry> list_library(const std::string& library_folder);

}  // namespace toothprep
