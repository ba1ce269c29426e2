// A whole file at once.
#pragma once

#include <string>
#include <string_view>

namespace toothprep {

// Writes `bytes` to the file `path`, replacing what it held. Throws Error with the system's reason
// if any of it can't be written. Callers go through Outputs (outputs.h).
void write_file(const std::string& path, std::string_view bytes);

}  // namespace toothprep
