#include "toothprep/tools/io/input_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/regular_file.h"

namespace toothprep {

InputFile::InputFile(std::string path) : path_(std::move(path)) {
  size_ = regular_file_size(path_);
  // Should a FIFO have taken the file's place meanwhile, it still doesn't block.
  descriptor_ = open(path_.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor_ < 0)
    throw InputError(path_, "", std::string("cannot be read: ") + std::strerror(errno));
  struct stat about {};
  if (fstat(descriptor_, &about) != 0 || !S_ISREG(about.st_mode)) {
    close(descriptor_);
    throw InputError(path_, "", "is not a regular file");
  }
  size_ = static_cast<std::uint64_t>(about.st_size);
}

void InputFile::require_at_most(std::uint64_t most) const {
  if (size_ > most)
    throw InputError(path_, "",
                     "holds " + std::to_string(size_) + " bytes, more than the " +
                         std::to_string(most) + " that such a file may have");
}

InputFile::~InputFile() { close(descriptor_); }

std::size_t InputFile::read(std::uint64_t at, std::size_t count, char* bytes) const {
  std::size_t done = 0;
  while (done < count) {
    const ssize_t n = pread(descriptor_, bytes + done, count - done, static_cast<off_t>(at + done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) break;
    done += static_cast<std::size_t>(n);
  }
  return done;
}

std::string bytes_of_file(const std::string& path, std::uint64_t most) {
  const InputFile file(path);
  file.require_at_most(most);
  std::string bytes(file.size(), '\0');
  bytes.resize(file.read(0, bytes.size(), bytes.data()));
  return bytes;
}

}  // namespace toothprep
