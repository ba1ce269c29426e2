// Recordings of live sessions that were not closed in order (killed, cut off) or are damaged: what
// can be read of them, as a file that every HDF5 program opens.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace toothprep {

struct Recovery {                 // what a recovered file holds, and what it lacks
  std::int64_t rows = 0;          // ticks in it
  double duration = 0;            // s, of them
  bool gives_up = false;          // something that is in the old file, if damaged
  std::vector<std::string> lost;  // what it lacks, a line each
};

// Writes `to` (replacing it): the rows up to where the first dataset ends or can't be read, all
// attributes that can, packed, with checksums of its own; recovered = 1, and complete = 0 unless
// the session was closed. Reads it back as a check. `from` is only read. Nothing, and `to` as it
// was, if `from` is complete and whole. Throws InputError if it is no recording of a live session
// or holds no row that can be read, Error if `to` can't be written.
[[nodiscard]] std::optional<Recovery> recover_session(const std::string& from,
                                                      const std::string& to);

}  // namespace toothprep
