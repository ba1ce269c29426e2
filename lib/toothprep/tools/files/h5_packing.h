// Chunks as HDF5's filters `shuffle` and `deflate` store them, packed outside HDF5: faster, and side
// by side.
#pragma once

#include <cstddef>
#include <vector>

namespace toothprep::h5 {

// The chunks of a dataset whose values, `size` bytes of `width` each, lie at `data`; what the last one
// has beyond them is zeros. Same values, same bytes, whatever the number of threads.
std::vector<std::vector<char>> packed_chunks(const void* data, std::size_t size, std::size_t width,
                                             std::size_t chunk_size);

}  // namespace toothprep::h5
