// How much memory a piece of work may take on this machine, asked before it is begun.
#pragma once

#include <cstdint>
#include <string>

namespace toothprep {

// Bytes that this process can still take: the least of what the machine has free (MemAvailable),
// what its control groups leave (versions 1 and 2, up to the root) and what its address space may
// grow to (ulimit -v).
std::uint64_t available_memory();

// Bytes as people say them: "1.9 GB", "35 MB" (of 10^9, 10^6 bytes).
std::string size_text(double bytes);

}  // namespace toothprep
