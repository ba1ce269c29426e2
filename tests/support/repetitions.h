// How often tests repeat what differs by chance only.
#pragma once

#include <cstdlib>

namespace toothprep {

// How many bytes or bits of a file are damaged, one at a time: as many as TOOTHPREP_FLIPS says
// (scripts/test-long), or `usual`.
inline int flips(int usual) {
  const char* wanted = std::getenv("TOOTHPREP_FLIPS");
  return wanted ? std::atoi(wanted) : usual;
}

}  // namespace toothprep
