#include "toothprep/tools/mesh_files/gzip.h"

#include <zlib.h>

#include <algorithm>
#include <vector>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/memory_limit.h"

namespace toothprep::mesh_files {
namespace {

constexpr double kBytesPerPlainByte = 4;  // of the mesh: the text, what is made of it, and growing
constexpr std::size_t kAtOnce = 1 << 20;

struct Inflation {
  z_stream stream{};
  explicit Inflation(const std::string& path) {
    if (inflateInit2(&stream, 15 + 16) != Z_OK) throw InputError(path, "", "can't be inflated");
  }
  ~Inflation() { inflateEnd(&stream); }
  Inflation(const Inflation&) = delete;
  Inflation& operator=(const Inflation&) = delete;
};

}  // namespace

std::string inflated(const InputFile& file) {
  const std::string& path = file.path();
  Inflation z(path);
  std::vector<char> packed(kAtOnce);
  std::string bytes;
  std::uint64_t next = 0;
  std::size_t done = 0;
  bool whole = false;  // a member's end was read, with the right checksum
  for (;;) {
    if (z.stream.avail_in == 0) {
      const std::size_t n = file.read(next, packed.size(), packed.data());
      if (n == 0) break;
      next += n;
      z.stream.next_in = reinterpret_cast<Bytef*>(packed.data());
      z.stream.avail_in = static_cast<uInt>(n);
    }
    if (whole) {  // another member, or what gzip ignores, too
      if (*z.stream.next_in != 0x1f || inflateReset(&z.stream) != Z_OK) break;
      whole = false;
    }
    if (bytes.size() < done + kAtOnce) {
      const std::size_t wanted = std::max(2 * bytes.size(), done + kAtOnce);
      require_memory(path, "inflated", kBytesPerPlainByte * static_cast<double>(wanted),
                     "thin the mesh out first");
      bytes.resize(wanted);
    }
    z.stream.next_out = reinterpret_cast<Bytef*>(bytes.data() + done);
    z.stream.avail_out = static_cast<uInt>(kAtOnce);
    const int status = inflate(&z.stream, Z_NO_FLUSH);
    done += kAtOnce - z.stream.avail_out;
    if (status == Z_STREAM_END)
      whole = true;
    else if (status != Z_OK && status != Z_BUF_ERROR)
      throw InputError(path, "",
                       done == 0 ? "is no gzip file" : "is damaged: it can't be inflated");
  }
  if (!whole) throw InputError(path, "", "is truncated: it ends too early");
  bytes.resize(done);
  return bytes;
}

}  // namespace toothprep::mesh_files
