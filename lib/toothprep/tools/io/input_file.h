// A regular file, opened for reading.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

namespace toothprep {

class InputFile {
 public:
  // Throws InputError at once for what is no regular file (a folder, a FIFO, a device), does not
  // exist or can't be opened.
  explicit InputFile(std::string path);
  ~InputFile();
  InputFile(const InputFile&) = delete;
  InputFile& operator=(const InputFile&) = delete;

  const std::string& path() const { return path_; }
  std::uint64_t size() const { return size_; }  // bytes, when it was opened
  int descriptor() const { return descriptor_; }

  // As many bytes as there are from `at` on, at most `count`. For several threads at once.
  std::size_t read(std::uint64_t at, std::size_t count, char* bytes) const;

 private:
  std::string path_;
  int descriptor_ = -1;
  std::uint64_t size_ = 0;
};

// The whole of a regular file. Throws InputError too if it holds more than `most` bytes.
std::string bytes_of_file(const std::string& path, std::uint64_t most = std::uint64_t{1} << 32);

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
