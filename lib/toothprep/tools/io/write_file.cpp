#include "toothprep/tools/io/write_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

[[noreturn]] void fail(const std::string& path, int error) {
  throw Error(path + ": cannot be written: " + std::generic_category().message(error));
}

}  // namespace

void write_file(const std::string& path, std::string_view bytes) {
  const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (file < 0) fail(path, errno);
  while (!bytes.empty()) {
    const ssize_t written = write(file, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) {
      const int error = written < 0 ? errno : ENOSPC;
      close(file);
      fail(path, error);
    }
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
  if (close(file) != 0) fail(path, errno);
}

}  // namespace toothprep
