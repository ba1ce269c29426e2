// The bytes of voxels in a file, as they are or deflated (zlib or gzip), read on demand.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

namespace toothprep::image {

class ByteStream {
 public:
  // Of `file` from `offset` on. Throws std::runtime_error if it can't be opened.
  ByteStream(const std::string& file, std::uint64_t offset, bool deflated);
  ~ByteStream();
  ByteStream(const ByteStream&) = delete;
  ByteStream& operator=(const ByteStream&) = delete;

  // Whether that many bytes stand at `at` (plain bytes, counted from the beginning); if so they are
  // in `bytes`. Of what is deflated only reading upwards is quick: to go back is to start anew. A
  // stream that is damaged holds nothing from there on. What isn't deflated may be read by several
  // threads at once.
  bool read(std::uint64_t at, std::size_t count, char* bytes);

  // Whether a deflated stream, read to here, has no checksum that fails.
  bool sound();

  bool deflated() const { return inflater_ != nullptr; }

 private:
  struct Inflater;
  int file_ = -1;
  std::uint64_t offset_ = 0;
  std::unique_ptr<Inflater> inflater_;
};

}  // namespace toothprep::image
