#include "toothprep/tools/io/rename.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <string>

namespace toothprep {
namespace fs = std::filesystem;
namespace {

// Older C libraries lack the names.
constexpr unsigned kNoReplace = 1, kExchange = 2;

int call(const fs::path& from, const fs::path& to, unsigned flags) {
  return syscall(SYS_renameat2, AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), flags) == 0 ? 0
                                                                                          : errno;
}

bool unsupported(int error) {
  return error == EINVAL || error == ENOSYS || error == EOPNOTSUPP || error == ENOTSUP;
}

int plain(const fs::path& from, const fs::path& to) {
  return std::rename(from.c_str(), to.c_str()) == 0 ? 0 : errno;
}

bool is_folder(const fs::path& path) {
  struct stat s {};
  return lstat(path.c_str(), &s) == 0 && S_ISDIR(s.st_mode);
}

// An empty file or folder that nobody else made.
int reserve(const fs::path& place, bool folder) {
  if (folder) return mkdir(place.c_str(), 0777) == 0 ? 0 : errno;
  const int file = open(place.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (file < 0) return errno;
  close(file);
  return 0;
}

void release(const fs::path& place, bool folder) {
  folder ? rmdir(place.c_str()) : unlink(place.c_str());
}

int plain_to_new(const fs::path& from, const fs::path& to) {
  const bool folder = is_folder(from);
  if (!folder) {
    if (link(from.c_str(), to.c_str()) == 0) {
      unlink(from.c_str());
      return 0;
    }
    if (errno != EPERM && !unsupported(errno)) return errno;
  }
  if (const int error = reserve(to, folder)) return error;
  const int error = plain(from, to);
  if (error) release(to, folder);
  return error;
}

int plain_exchange(const fs::path& from, const fs::path& to) {
  const fs::path aside = from.string() + "-old";
  if (const int error = plain(to, aside)) return error;
  if (const int error = plain(from, to)) {
    plain(aside, to);
    return error;
  }
  return plain(aside, from);
}

}  // namespace

int rename_to_new(const fs::path& from, const fs::path& to, RenameCalls calls) {
  if (calls == RenameCalls::kBest)
    if (const int error = call(from, to, kNoReplace); !unsupported(error)) return error;
  return plain_to_new(from, to);
}

int exchange(const fs::path& from, const fs::path& to, RenameCalls calls) {
  if (calls == RenameCalls::kBest)
    if (const int error = call(from, to, kExchange); !unsupported(error)) return error;
  return plain_exchange(from, to);
}

}  // namespace toothprep
