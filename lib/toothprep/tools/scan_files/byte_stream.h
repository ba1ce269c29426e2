// The bytes of voxels in a file, as they are or deflated (zlib or gzip), read on demand.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "toothprep/tools/io/input_file.h"

namespace toothprep::image {

class ByteStream {
 public:
  // Of `file` from `offset` on. Throws InputError if it is no regular file or can't be opened.
  ByteStream(const std::string& file, std::uint64_t offset, bool deflated);
  ~ByteStream();
  ByteStream(const ByteStream&) = delete;
  ByteStream& operator=(const ByteStream&) = delete;

  // Whether that many bytes stand at `at` (plain bytes, counted from the beginning); if so they are
  // in `bytes`. Of what is deflated only reading upwards is quick: to go back is to start anew. A
  // stream that is damaged holds nothing from there on. What isn't deflated may be read by several
  // threads at once.
  bool read(std::uint64_t at, std::size_t count, char* bytes);

  // What a deflated stream is, read to its end: whole and of so many plain bytes, or not.
  enum class State { kWhole, kDamaged, kTooShort, kTooLong };
  State read_to_end(std::uint64_t bytes);

  bool damaged() const;  // as far as it was read
  bool deflated() const { return inflater_ != nullptr; }

 private:
  struct Inflater;
  InputFile file_;
  std::uint64_t offset_ = 0;
  std::unique_ptr<Inflater> inflater_;
};

}  // namespace toothprep::image
