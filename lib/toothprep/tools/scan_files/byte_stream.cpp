#include "toothprep/tools/scan_files/byte_stream.h"

#include <zlib.h>

#include <algorithm>
#include <stdexcept>
#include <vector>

namespace toothprep::image {

struct ByteStream::Inflater {
  z_stream stream{};
  std::vector<char> packed = std::vector<char>(1 << 18);
  std::uint64_t next = 0;  // where in the file the next packed bytes are
  std::uint64_t out = 0;   // plain bytes so far
  // A member is whole once its checksum was read and is right; zlib compares them.
  enum { kInMember, kBetweenMembers, kEnded, kDamaged } state = kInMember;

  explicit Inflater(std::uint64_t offset) : next(offset) {
    if (inflateInit2(&stream, 15 + 32) != Z_OK)  // zlib or gzip, by its header
      throw std::runtime_error("can't be inflated");
  }
  ~Inflater() { inflateEnd(&stream); }
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;

  bool fill(const InputFile& file) {
    const std::size_t n = file.read(next, packed.size(), packed.data());
    next += n;
    stream.next_in = reinterpret_cast<Bytef*>(packed.data());
    stream.avail_in = static_cast<uInt>(n);
    return n > 0;
  }

  // A gzip file may have several members; what is none is ignored, as gzip does.
  void begin_next_member() {
    constexpr Bytef kGzip = 0x1f, kZlib = 0x78;
    const bool begins = *stream.next_in == kGzip || *stream.next_in == kZlib;
    state = begins && inflateReset(&stream) == Z_OK ? kInMember : kEnded;
  }

  // As many bytes as there are, at most `count`.
  std::size_t read(const InputFile& file, std::size_t count, char* bytes) {
    std::size_t done = 0;
    while (done < count && state != kEnded && state != kDamaged &&
           (stream.avail_in > 0 || fill(file))) {
      if (state == kBetweenMembers) begin_next_member();
      if (state != kInMember) break;
      const auto wanted = static_cast<uInt>(std::min<std::size_t>(count - done, 1u << 30));
      stream.next_out = reinterpret_cast<Bytef*>(bytes + done);
      stream.avail_out = wanted;
      const int status = inflate(&stream, Z_NO_FLUSH);
      done += wanted - stream.avail_out;
      if (status == Z_STREAM_END)
        state = kBetweenMembers;
      else if (status != Z_OK && status != Z_BUF_ERROR)
        state = kDamaged;
    }
    out += done;
    return done;
  }
};

ByteStream::ByteStream(const std::string& file, std::uint64_t offset, bool deflated)
    : file_(file), offset_(offset) {
  if (deflated) inflater_ = std::make_unique<Inflater>(offset);
}

ByteStream::~ByteStream() = default;

bool ByteStream::read(std::uint64_t at, std::size_t count, char* bytes) {
  if (!inflater_) return file_.read(offset_ + at, count, bytes) == count;
  if (at < inflater_->out) inflater_ = std::make_unique<Inflater>(offset_);
  std::vector<char> skipped(std::min<std::uint64_t>(at - inflater_->out, 1 << 20));
  while (inflater_->out < at) {
    const auto n = std::min<std::uint64_t>(at - inflater_->out, skipped.size());
    if (inflater_->read(file_, n, skipped.data()) != n) return false;
  }
  return inflater_->read(file_, count, bytes) == count;
}

ByteStream::State ByteStream::read_to_end(std::uint64_t bytes) {
  if (!inflater_) return State::kWhole;
  Inflater& z = *inflater_;
  std::vector<char> skipped(1 << 20);
  while (z.out <= bytes && z.read(file_, skipped.size(), skipped.data()) > 0) {
  }
  if (z.state == Inflater::kDamaged) return State::kDamaged;
  if (z.out > bytes) return State::kTooLong;
  return z.out < bytes || z.state == Inflater::kInMember ? State::kTooShort : State::kWhole;
}

bool ByteStream::damaged() const { return inflater_ && inflater_->state == Inflater::kDamaged; }

}  // namespace toothprep::image
