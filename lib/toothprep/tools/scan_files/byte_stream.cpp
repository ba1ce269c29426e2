#include "toothprep/tools/scan_files/byte_stream.h"

#include <fcntl.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <stdexcept>
#include <vector>

namespace toothprep::image {
namespace {

// As many bytes as there are, at most `count`.
std::size_t read_at(int file, std::uint64_t at, std::size_t count, char* bytes) {
  std::size_t done = 0;
  while (done < count) {
    const ssize_t n = pread(file, bytes + done, count - done, static_cast<off_t>(at + done));
    if (n <= 0) break;
    done += static_cast<std::size_t>(n);
  }
  return done;
}

}  // namespace

struct ByteStream::Inflater {
  z_stream stream{};
  std::vector<char> packed = std::vector<char>(1 << 18);
  std::uint64_t next = 0;  // where in the file the next packed bytes are
  std::uint64_t out = 0;   // plain bytes so far
  bool damaged = false;
  bool ended = false;  // a member has just been read to its end, and its checksum is right

  explicit Inflater(std::uint64_t offset) : next(offset) {
    if (inflateInit2(&stream, 15 + 32) != Z_OK)  // zlib or gzip, by its header
      throw std::runtime_error("can't be inflated");
  }
  ~Inflater() { inflateEnd(&stream); }
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;

  bool fill(int file) {
    const std::size_t n = read_at(file, next, packed.size(), packed.data());
    next += n;
    stream.next_in = reinterpret_cast<Bytef*>(packed.data());
    stream.avail_in = static_cast<uInt>(n);
    return n > 0;
  }

  // As many bytes as there are, at most `count`.
  std::size_t read(int file, std::size_t count, char* bytes) {
    std::size_t done = 0;
    while (done < count && !damaged && (stream.avail_in > 0 || fill(file))) {
      const auto room = static_cast<uInt>(std::min<std::size_t>(count - done, 1u << 30));
      stream.next_out = reinterpret_cast<Bytef*>(bytes + done);
      stream.avail_out = room;
      const int status = inflate(&stream, Z_NO_FLUSH);
      done += room - stream.avail_out;
      ended = status == Z_STREAM_END;
      if (ended)
        inflateReset(&stream);  // gzip files may have several members
      else if (status != Z_OK && status != Z_BUF_ERROR)
        damaged = true;
    }
    out += done;
    return done;
  }
};

ByteStream::ByteStream(const std::string& file, std::uint64_t offset, bool deflated)
    : file_(open(file.c_str(), O_RDONLY | O_CLOEXEC)), offset_(offset) {
  if (file_ < 0) throw std::runtime_error("can't be opened");
  if (deflated) inflater_ = std::make_unique<Inflater>(offset);
}

ByteStream::~ByteStream() { close(file_); }

bool ByteStream::read(std::uint64_t at, std::size_t count, char* bytes) {
  if (!inflater_) return read_at(file_, offset_ + at, count, bytes) == count;
  if (at < inflater_->out) inflater_ = std::make_unique<Inflater>(offset_);
  std::vector<char> skipped(std::min<std::uint64_t>(at - inflater_->out, 1 << 20));
  while (inflater_->out < at) {
    const auto n = std::min<std::uint64_t>(at - inflater_->out, skipped.size());
    if (inflater_->read(file_, n, skipped.data()) != n) return false;
  }
  return inflater_->read(file_, count, bytes) == count;
}

bool ByteStream::sound() {
  if (!inflater_) return true;
  // The checksum stands behind the last byte, so another one is asked for.
  Inflater& z = *inflater_;
  if (z.ended) return true;
  char more = 0;
  z.stream.next_out = reinterpret_cast<Bytef*>(&more);
  z.stream.avail_out = 1;
  while (z.stream.avail_out > 0 && (z.stream.avail_in > 0 || z.fill(file_))) {
    const int status = inflate(&z.stream, Z_NO_FLUSH);
    if (status == Z_STREAM_END) return true;
    if (status != Z_OK && status != Z_BUF_ERROR) return false;
  }
  return true;
}

}  // namespace toothprep::image
