// That a file at a path is being written by a process that runs: a lock on the name, which vanishes
// with its process however that ends, leaves nothing behind and is in no reader's way.
#pragma once

#include <filesystem>
#include <string>

namespace toothprep {

// On this machine. (An abstract socket named by the folder's device and inode and the file's name.)
class PathLock {
 public:
  // Throws Error that calls the file `shown` if another one holds it, in this process or elsewhere.
  PathLock(const std::filesystem::path& path, const std::string& shown);
  ~PathLock();
  PathLock(const PathLock&) = delete;
  PathLock& operator=(const PathLock&) = delete;

 private:
  int socket_ = -1;
};

// Throws the error of PathLock's constructor if somebody holds it.
void refuse_if_locked(const std::filesystem::path& path, const std::string& shown);

}  // namespace toothprep
