#include "fuzz_target.h"

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "toothprep/step/core/errors.h"

namespace toothprep::fuzz {
namespace {

namespace fs = std::filesystem;

void write_file(const fs::path& path, const char* data, std::size_t size) {
  std::ofstream out(path, std::ios::binary);
  out.write(data, static_cast<std::streamsize>(size));
  out.close();
  if (!out) std::abort();
}

// A folder in memory, removed when the program ends in order. $TOOTHPREP_FUZZ_FOLDER: where.
class Folder {
 public:
  Folder() {
    const char* given = std::getenv("TOOTHPREP_FUZZ_FOLDER");
    path_ = fs::path(given ? given : "/dev/shm") / ("fuzz-" + std::to_string(getpid()));
    fs::create_directories(path_);
    const std::string beside(4096, '\7');
    write_file(path_ / "beside.raw", beside.data(), beside.size());
  }
  ~Folder() {
    std::error_code error;
    fs::remove_all(path_, error);
  }
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

}  // namespace

bool read_bytes(const Target& target, const std::uint8_t* data, std::size_t size) {
  static const Folder folder;
  std::size_t choice = 0;
  if (target.file_names.size() > 1) {
    if (size < 1) return false;
    choice = data[0] % target.file_names.size();
    ++data, --size;
  }
  const fs::path path = folder.path() / target.file_names[choice];
  write_file(path, reinterpret_cast<const char*>(data), size);
  bool taken = true;
  try {
    target.read(path.string());
  } catch (const Error&) {
    taken = false;
  }
  fs::remove(path);
  return taken;
}

}  // namespace toothprep::fuzz
