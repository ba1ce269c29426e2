#include "toothprep/tools/io/write_file.h"

#include <fcntl.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <filesystem>
#include <system_error>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

[[noreturn]] void fail(const std::string& path, int error) {
  throw Error(path + ": cannot be written: " + why_not_written(path, error));
}

constexpr std::uint64_t kNothingFree = 1 << 20;  // bytes: less is a full disk

bool disk_is_full(const std::string& path) {
  std::filesystem::path folder = std::filesystem::path(path).parent_path();
  if (folder.empty()) folder = ".";
  struct statvfs disk {};
  return statvfs(folder.c_str(), &disk) == 0 &&
         (disk.f_bavail * disk.f_frsize < kNothingFree || (disk.f_files > 0 && disk.f_favail == 0));
}

}  // namespace

std::string why_not_written(const std::string& path, int error) {
  switch (error) {
    case ENOSPC:
      return "the disk is full";
    case EDQUOT:
      return "the disk quota is used up";
    case EFBIG:
      return "the file would get larger than is allowed here (ulimit -f)";
    case EACCES:
    case EPERM:
    case EROFS:
    case EIO:
    case EISDIR:
    case ENOENT:
    case ENOTDIR:
    case ENAMETOOLONG:
      return std::generic_category().message(error);
    default:
      break;
  }
  if (disk_is_full(path)) return "the disk is full";
  return error == 0 ? "the cause is not known" : std::generic_category().message(error);
}

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
