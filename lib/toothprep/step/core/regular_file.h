// What every reader asks before it opens a file.
#pragma once

#include <cstdint>
#include <string>

namespace toothprep {

// The size in bytes of the regular file at `path` (links are followed). The file is not opened, so
// that a FIFO can't block and a device can't be read without end. Throws InputError if nothing is
// there, or a folder, a FIFO, a device, a socket.
std::uint64_t regular_file_size(const std::string& path);

}  // namespace toothprep
