#include "toothprep/tools/files/h5_packing.h"

#include <libdeflate.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <new>

namespace toothprep::h5 {
namespace {

constexpr int kLevel = 1;
constexpr std::size_t kStoredBlock = 65535;  // a stored block's most bytes (RFC 1951)

class Packer {
 public:
  // `width`: of a value, `size`: of a chunk; both in bytes.
  Packer(std::size_t width, std::size_t size)
      : compressor_(libdeflate_alloc_compressor(kLevel), libdeflate_free_compressor),
        width_(width),
        shuffled_(size) {
    if (!compressor_) throw std::bad_alloc();
    const std::size_t blocks = size / kStoredBlock + 1;
    packed_.resize(libdeflate_deflate_compress_bound(compressor_.get(), size) + 5 * blocks + 6);
  }

  // A stream of zlib's format (RFC 1950). Its beginning, the low bytes of measured values, is often
  // noise: that much is stored as it is.
  std::vector<char> pack(const char* data, std::size_t size) {
    shuffle(data, size);
    const std::size_t plane = shuffled_.size() / width_;
    std::size_t stored = 0;
    while (stored + plane < shuffled_.size() && is_noise(shuffled_.data() + stored, plane))
      stored += plane;
    at_ = 0;
    for (const std::size_t head : {0x78, 0x01}) put(head);
    for (std::size_t from = 0; from < stored; from += kStoredBlock)
      store(shuffled_.data() + from, std::min(kStoredBlock, stored - from));
    at_ += libdeflate_deflate_compress(compressor_.get(), shuffled_.data() + stored,
                                       shuffled_.size() - stored, packed_.data() + at_,
                                       packed_.size() - at_);
    const std::uint32_t sum = libdeflate_adler32(1, shuffled_.data(), shuffled_.size());
    for (const int shift : {24, 16, 8, 0}) put(sum >> shift);
    return {packed_.begin(), packed_.begin() + static_cast<std::ptrdiff_t>(at_)};
  }

 private:
  // All first bytes of the values, then all second ones, and so on.
  void shuffle(const char* data, std::size_t size) {
    const std::size_t plane = shuffled_.size() / width_, values = size / width_;
    if (size < shuffled_.size()) std::fill(shuffled_.begin(), shuffled_.end(), '\0');
    for (std::size_t byte = 0; byte < width_; ++byte)
      for (std::size_t i = 0; i < values; ++i)
        shuffled_[byte * plane + i] = data[i * width_ + byte];
  }

  // By a sample from the middle, which deflate makes hardly shorter.
  bool is_noise(const char* plane, std::size_t size) {
    const std::size_t sample = std::min<std::size_t>(size, 4096);
    return libdeflate_deflate_compress(compressor_.get(), plane + (size - sample) / 2, sample,
                                       packed_.data(), sample * 9 / 10) == 0;
  }

  void store(const char* bytes, std::size_t size) {
    put(0);  // a stored block, not the last one
    for (const std::size_t number : {size, ~size}) {
      put(number);
      put(number >> 8);
    }
    std::copy(bytes, bytes + size, packed_.data() + at_);
    at_ += size;
  }

  void put(std::size_t byte) { packed_[at_++] = static_cast<char>(byte & 0xff); }

  std::unique_ptr<libdeflate_compressor, void (*)(libdeflate_compressor*)> compressor_;
  std::size_t width_;
  std::vector<char> shuffled_, packed_;
  std::size_t at_ = 0;  // where the next byte goes
};

}  // namespace

std::vector<std::vector<char>> packed_chunks(const void* data, std::size_t size, std::size_t width,
                                             std::size_t chunk_size) {
  const char* bytes = static_cast<const char*>(data);
  std::vector<std::vector<char>> chunks((size + chunk_size - 1) / chunk_size);
  // Isolated: a thread that waits here may hold a lock, and must not begin other work that wants it.
  tbb::this_task_arena::isolate([&] {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, chunks.size()), [&](const auto& range) {
      Packer packer(width, chunk_size);
      for (std::size_t i = range.begin(); i < range.end(); ++i)
        chunks[i] =
            packer.pack(bytes + i * chunk_size, std::min(chunk_size, size - i * chunk_size));
    });
  });
  return chunks;
}

}  // namespace toothprep::h5
