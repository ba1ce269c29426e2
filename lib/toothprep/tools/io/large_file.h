// Files of many megabytes, read by all cores. Apart from input_file.h: the stand-in for the vendor's library reads small
// files alone, without threads of its own.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

namespace toothprep {

// What a large file holds, in memory that wasn't set to zero first.
struct FileBytes {
  std::unique_ptr<char[]> storage;
  std::size_t size = 0;
  std::span<char> all() const { return {storage.get(), size}; }
};

// As bytes_of_file(), read in pieces by all cores. `take` gets each piece in the file's order,
// while those after it are read; what it throws is thrown.
FileBytes large_file(const std::string& path, std::uint64_t most,
                     const std::function<void(std::span<const char> piece)>& take);

}  // namespace toothprep
