#include "toothprep/tools/io/path_lock.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstring>
#include <system_error>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"

namespace toothprep {
namespace fs = std::filesystem;
namespace {

// Without links, so that it is the same by whatever name.
std::string name_of(const fs::path& path) {
  std::error_code error;
  const fs::path real = fs::weakly_canonical(fs::absolute(path, error), error);
  struct stat folder {};
  if (error || stat(real.parent_path().c_str(), &folder) != 0) return path.string();
  return std::to_string(folder.st_dev) + ':' + std::to_string(folder.st_ino) + ':' +
         real.filename().string();
}

}  // namespace

PathLock::PathLock(const fs::path& path, const std::string& shown) {
  Sha256 hash;
  const std::string name = name_of(path);
  hash.update(name.data(), name.size());
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  // A zero byte first: the name is no file's, and free as soon as the socket is closed.
  const std::string key = "toothprep-" + hash.hex();
  std::memcpy(address.sun_path + 1, key.data(), key.size());
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + key.size());
  socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (socket_ < 0)
    throw Error(shown + ": cannot be locked: " + std::generic_category().message(errno));
  if (bind(socket_, reinterpret_cast<const sockaddr*>(&address), length) == 0) return;
  const int error = errno;
  close(socket_);
  if (error == EADDRINUSE)
    throw InputError(shown, "", "is being recorded by a session that still runs",
                     "end that session or choose another name");
  throw Error(shown + ": cannot be locked: " + std::generic_category().message(error));
}

PathLock::~PathLock() { close(socket_); }

void refuse_if_locked(const fs::path& path, const std::string& shown) {
  const PathLock free(path, shown);
}

}  // namespace toothprep
