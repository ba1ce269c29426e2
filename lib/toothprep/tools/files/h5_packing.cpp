#include "toothprep/tools/files/h5_packing.h"

#include <libdeflate.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cerrno>
#include <cstdint>
#include <cstring>
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
    if (width_ == 8)
      shuffle<8>(data, values, plane, shuffled_.data());
    else if (width_ == 4)
      shuffle<4>(data, values, plane, shuffled_.data());
    else
      std::copy_n(data, values, shuffled_.data());
  }
  template <std::size_t kWidth>
  static void shuffle(const char* data, std::size_t values, std::size_t plane, char* to) {
    for (std::size_t i = 0; i < values; ++i)
      for (std::size_t byte = 0; byte < kWidth; ++byte)
        to[byte * plane + i] = data[i * kWidth + byte];
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

class Unpacker {
 public:
  Unpacker(int file, std::size_t width, std::size_t chunk_size)
      : decompressor_(libdeflate_alloc_decompressor(), libdeflate_free_decompressor),
        file_(file),
        width_(width),
        shuffled_(chunk_size) {
    if (!decompressor_) throw std::bad_alloc();
  }

  // Its first `count` values; false if it can't be unpacked.
  bool unpack(const ChunkPlaces::Place& place, std::size_t count, double* values) {
    packed_.resize(place.size);
    if (!read(place.at) || libdeflate_zlib_decompress(
                               decompressor_.get(), packed_.data(), packed_.size(),
                               shuffled_.data(), shuffled_.size(), nullptr) != LIBDEFLATE_SUCCESS)
      return false;
    if (width_ == 8)
      put<std::uint64_t>(count, values);
    else if (width_ == 4)
      put<std::uint32_t>(count, values);
    else
      put<std::uint8_t>(count, values);
    return true;
  }

 private:
  bool read(std::uint64_t at) {
    for (std::size_t done = 0; done < packed_.size();) {
      const ssize_t n =
          pread(file_, packed_.data() + done, packed_.size() - done, static_cast<off_t>(at + done));
      if (n == 0 || (n < 0 && errno != EINTR)) return false;
      if (n > 0) done += static_cast<std::size_t>(n);
    }
    return true;
  }

  // Bits: an integer of a value's size.
  template <class Bits>
  void put(std::size_t count, double* values) const {
    const std::size_t plane = shuffled_.size() / sizeof(Bits);
    for (std::size_t i = 0; i < count; ++i) {
      Bits bits = 0;
      for (std::size_t byte = 0; byte < sizeof(Bits); ++byte)
        bits =
            static_cast<Bits>(bits | static_cast<Bits>(shuffled_[byte * plane + i]) << (8 * byte));
      if constexpr (sizeof(Bits) == sizeof(double))
        values[i] = std::bit_cast<double>(bits);
      else
        values[i] = bits;
    }
  }

  std::unique_ptr<libdeflate_decompressor, void (*)(libdeflate_decompressor*)> decompressor_;
  int file_;
  std::size_t width_;
  std::vector<unsigned char> packed_, shuffled_;
};

}  // namespace

std::vector<std::vector<char>> packed_chunks(const void* data, std::size_t size, std::size_t width,
                                             std::size_t chunk_size) {
  const char* bytes = static_cast<const char*>(data);
  std::vector<std::vector<char>> chunks((size + chunk_size - 1) / chunk_size);
  // What stands for long, as a motor's rate or a bur's orientation, is packed once.
  const auto is_again = [&](std::size_t i) {
    const char* const chunk = bytes + i * chunk_size;
    return i > 0 && (i + 1) * chunk_size <= size &&
           std::memcmp(chunk - chunk_size, chunk, chunk_size) == 0;
  };
  // Isolated: a thread that waits here may hold a lock, and must not begin other work that wants it.
  tbb::this_task_arena::isolate([&] {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, chunks.size()), [&](const auto& range) {
      Packer packer(width, chunk_size);
      for (std::size_t i = range.begin(); i < range.end(); ++i)
        if (!is_again(i))
          chunks[i] =
              packer.pack(bytes + i * chunk_size, std::min(chunk_size, size - i * chunk_size));
    });
  });
  for (std::size_t i = 1; i < chunks.size(); ++i)
    if (chunks[i].empty()) chunks[i] = chunks[i - 1];
  return chunks;
}

std::optional<std::vector<double>> unpacked_values(int file, const ChunkPlaces& chunks,
                                                   std::size_t count, bool alone) {
  std::vector<double> values(count);
  const std::size_t each = chunks.chunk_size / chunks.width;
  std::atomic<bool> good{true};
  const auto unpack = [&](const tbb::blocked_range<std::size_t>& range) {
    Unpacker unpacker(file, chunks.width, chunks.chunk_size);
    for (std::size_t i = range.begin(); i < range.end() && good; ++i)
      if (!unpacker.unpack(chunks.places[i], std::min(each, count - i * each),
                           values.data() + i * each))
        good = false;
  };
  const tbb::blocked_range<std::size_t> all(0, chunks.places.size());
  if (alone)
    unpack(all);
  else  // isolated as above
    tbb::this_task_arena::isolate([&] { tbb::parallel_for(all, unpack); });
  if (!good) return {};
  return values;
}

}  // namespace toothprep::h5
