// How much memory a piece of work may take on this machine, asked before it is begun.
#pragma once

#include <cstdint>
#include <string>

namespace toothprep {

// Bytes that this process can still take: the least of what the machine has free (MemAvailable),
// what its control groups leave (versions 1 and 2, up to the root) and what its address space may
// grow to (ulimit -v).
std::uint64_t available_memory();

// Throws InputError "FILE: PLACE: needs 8.6 GB of memory, 2.1 GB are available; REMEDY" if the work
// would take more than that.
void require_memory(const std::string& file, const std::string& place, double bytes,
                    const std::string& remedy);

// What a box of voxels will take, announced before the work: "187 million voxels of 0.02 mm: about
// 5.6 GB of memory and 75 s", or empty if it is less than a gigabyte and half a minute. Throws Error
// if the machine doesn't have the memory, or for more than 2^29 voxels, naming a voxel size for
// which it would do.
std::string announced_voxels(double voxels, double voxel_mm, double bytes_per_voxel,
                             double seconds_per_voxel);

// Bytes as people say them: "1.9 GB", "35 MB" (of 10^9, 10^6 bytes).
std::string size_text(double bytes);

}  // namespace toothprep
