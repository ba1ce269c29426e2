#include "toothprep/tools/io/input_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <tbb/parallel_pipeline.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/regular_file.h"

namespace toothprep {
namespace {

constexpr std::size_t kPiece = std::size_t{1} << 22;  // bytes
constexpr std::size_t kPiecesAtOnce = 16;

void check_size(const InputFile& file, std::uint64_t most) {
  if (file.size() > most)
    throw InputError(file.path(), "",
                     "holds " + std::to_string(file.size()) + " bytes, more than the " +
                         std::to_string(most) + " that such a file may have");
}

}  // namespace

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
  check_size(file, most);
  std::string bytes(file.size(), '\0');
  bytes.resize(file.read(0, bytes.size(), bytes.data()));
  return bytes;
}

FileBytes large_file(const std::string& path, std::uint64_t most,
                     const std::function<void(std::span<const char>)>& take) {
  const InputFile file(path);
  check_size(file, most);
  const std::size_t size = file.size();
  FileBytes bytes{std::unique_ptr<char[]>(new char[size]), 0};
  const auto length_at = [&](std::size_t at) { return std::min(kPiece, size - at); };
  std::size_t next = 0;
  bool ended = false;  // the file has become shorter
  tbb::parallel_pipeline(
      kPiecesAtOnce, tbb::make_filter<void, std::size_t>(tbb::filter_mode::serial_in_order,
                                                         [&](tbb::flow_control& control) {
                                                           const std::size_t at = next;
                                                           if (at == size)
                                                             control.stop();
                                                           else
                                                             next += length_at(at);
                                                           return at;
                                                         }) &
                         tbb::make_filter<std::size_t, std::span<const char>>(
                             tbb::filter_mode::parallel,
                             [&](std::size_t at) {
                               char* piece = bytes.storage.get() + at;
                               return std::span<const char>(piece,
                                                            file.read(at, length_at(at), piece));
                             }) &
                         tbb::make_filter<std::span<const char>, void>(
                             tbb::filter_mode::serial_in_order, [&](std::span<const char> piece) {
                               if (ended) return;
                               ended = piece.size() < length_at(bytes.size);
                               bytes.size += piece.size();
                               take(piece);
                             }));
  return bytes;
}

}  // namespace toothprep
