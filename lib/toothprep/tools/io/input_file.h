// A regular file, opened for reading.
#pragma once

#include <cstddef>
#include <cstdint>
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

  // Throws InputError if it is larger than `most` bytes.
  void require_at_most(std::uint64_t most) const;
  // As many bytes as there are from `at` on, at most `count`. For several threads at once.
  std::size_t read(std::uint64_t at, std::size_t count, char* bytes) const;

 private:
  std::string path_;
  int descriptor_ = -1;
  std::uint64_t size_ = 0;
};

// The whole of a regular file. Throws InputError too if it holds more than `most` bytes.
std::string bytes_of_file(const std::string& path, std::uint64_t most = std::uint64_t{1} << 32);

}  // namespace toothprep
