// A whole file at once.
#pragma once

#include <string>
#include <string_view>

namespace toothprep {

// Writes `bytes` to the file `path`, replacing what it held. Throws Error with the system's reason
// if any of it can't be written. Callers go through Outputs (outputs.h).
void write_file(const std::string& path, std::string_view bytes);

// Why writing to `path` failed, in words. `error` is the system's; a library that loses it gives 0,
// or one that has nothing to do with writing: then the disk is said to be full if it is.
std::string why_not_written(const std::string& path, int error);

}  // namespace toothprep
