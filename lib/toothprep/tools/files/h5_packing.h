// Chunks as HDF5's filters `shuffle` and `deflate` store them, packed and unpacked outside HDF5: faster,
// and side by side.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace toothprep::h5 {

// The chunks of a dataset whose values, `size` bytes of `width` each, lie at `data`; what the last one
// has beyond them is zeros. Same values, same bytes, whatever the number of threads.
std::vector<std::vector<char>> packed_chunks(const void* data, std::size_t size, std::size_t width,
                                             std::size_t chunk_size);

// Where the chunks of a dataset lie in a file, in the order of its values.
struct ChunkPlaces {
  struct Place {
    std::uint64_t at = 0, size = 0;  // bytes
  };
  std::vector<Place> places;
  std::size_t width = 0;       // bytes of a value: 8 of doubles, 4 and 1 of numbers without sign
  std::size_t chunk_size = 0;  // bytes of values
};

// The first `count` values of chunks that are packed so. Nothing if one of them isn't: can't be read,
// or isn't a stream of zlib's format of just a chunk's size with the right checksum. `alone`: by this
// thread only.
std::optional<std::vector<double>> unpacked_values(int file, const ChunkPlaces& chunks,
                                                   std::size_t count, bool alone);

}  // namespace toothprep::h5
