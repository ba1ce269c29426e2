#include "toothprep/tools/scan_files/dicom_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <stdexcept>

#include "toothprep/tools/scan_files/image_checks.h"

namespace toothprep::image {
namespace {

constexpr std::uint32_t kUndefined = 0xffffffff, kItem = 0xfffee000, kItemEnd = 0xfffee00d,
                        kSequenceEnd = 0xfffee0dd, kPixels = 0x7fe00010, kSyntax = 0x00020010;
constexpr int kDepth = 32;  // of nested sequences
constexpr std::size_t kMostInflated = std::size_t{1} << 32;

// The sequences that are needed, where a file doesn't say that they are sequences (implicit).
constexpr std::array<std::uint32_t, 6> kSequences = {0x52009229, 0x52009230, 0x00289110,
                                                     0x00209113, 0x00209116, 0x00289145};

constexpr std::string_view kKinds =
    "AE AS AT CS DA DS DT FD FL IS LO LT OB OD OF OL OV OW PN SH SL SQ SS ST SV TM UC UI UL UN UR "
    "US UT UV ";
constexpr std::string_view kLongKinds = "OB OD OF OL OV OW SQ SV UC UN UR UT UV ";

struct Encoding {
  bool implicit = false, big = false, compressed = false;
};

class Parser {
 public:
  Parser(std::string_view bytes, std::size_t at) : bytes_(bytes), at_(at) {}

  std::size_t at() const { return at_; }

  // Elements up to `end`, or up to the delimiter if `delimited`; at the top, up to the pixels.
  DicomItems elements(std::size_t end, bool delimited, Encoding how, int depth, DicomFile* file) {
    if (depth > kDepth) fail("its sequences are nested too deeply");
    DicomItems items;
    while (at_ < end) {
      if (meta_ && peek_group() != 2) break;
      const std::uint32_t tag = next_tag(end, how);
      if (tag == kItemEnd && delimited) {
        if (next32(end, how) != 0) fail("a delimiter has a length");
        return items;
      }
      if (tag >> 16 == 0xfffe) fail("a delimiter stands where none belongs");
      DicomElement& element = items.elements[tag];
      Encoding inner = how;
      std::uint32_t length = 0;
      bool sequence = false;
      if (how.implicit) {
        length = next32(end, how);
        sequence = is_sequence(tag) || (length == kUndefined && tag != kPixels);
      } else {
        need(end, 2);
        const std::string kind = std::string(bytes_.substr(at_, 2)) + ' ';
        if (kKinds.find(kind) == std::string_view::npos) fail("an element is of no known kind");
        at_ += 2;
        if (kLongKinds.find(kind) != std::string_view::npos) {
          need(end, 2);
          at_ += 2;
          length = next32(end, how);
        } else {
          length = next16(end, how);
        }
        sequence = kind == "SQ ";
        if (kind == "UN " && (length == kUndefined || is_sequence(tag))) {
          sequence = true;
          inner.implicit = true;
        }
      }
      if (tag == kPixels && file != nullptr) {
        pixels(end, how, length, *file);
        return items;  // what some programs leave behind the pixels doesn't matter
      }
      if (sequence) {
        element.items = items_of(end, length, inner, depth);
        continue;
      }
      if (length == kUndefined) {  // an icon's fragments
        if (tag != kPixels) fail("an element has no length");
        if (!fragments(end, how)) fail("fragments end too early");
        continue;
      }
      need(end, length);
      element.value = bytes_.substr(at_, length);
      at_ += length;
    }
    if (delimited) fail("an item has no end");
    return items;
  }

  DicomItems meta() {
    meta_ = true;
    DicomFile none;
    DicomItems items = elements(bytes_.size(), false, {}, 0, &none);
    meta_ = false;
    return items;
  }

 private:
  [[noreturn]] void fail(const std::string& why) const {
    throw std::runtime_error(why + " (byte " + std::to_string(at_) + ")");
  }
  void need(std::size_t end, std::size_t count) const {
    if (count > end - at_) fail("an element is longer than what holds it");
  }
  unsigned byte(std::size_t i) const { return static_cast<unsigned char>(bytes_[at_ + i]); }
  unsigned peek_group() const {
    need(bytes_.size(), 2);
    return byte(0) | byte(1) << 8;
  }
  std::uint32_t next16(std::size_t end, Encoding how) {
    need(end, 2);
    const unsigned value = how.big ? byte(0) << 8 | byte(1) : byte(1) << 8 | byte(0);
    at_ += 2;
    return value;
  }
  std::uint32_t next32(std::size_t end, Encoding how) {
    const std::uint32_t first = next16(end, how), second = next16(end, how);
    return how.big ? first << 16 | second : second << 16 | first;
  }
  std::uint32_t next_tag(std::size_t end, Encoding how) {
    const std::uint32_t group = next16(end, how);
    return group << 16 | next16(end, how);
  }
  static bool is_sequence(std::uint32_t tag) {
    return std::find(kSequences.begin(), kSequences.end(), tag) != kSequences.end();
  }

  std::vector<DicomItems> items_of(std::size_t end, std::uint32_t length, Encoding how, int depth) {
    std::vector<DicomItems> items;
    const bool delimited = length == kUndefined;
    if (!delimited) {
      need(end, length);
      end = at_ + length;
    }
    while (at_ < end) {
      const std::uint32_t tag = next_tag(end, how), size = next32(end, how);
      if (tag == kSequenceEnd && delimited) return items;
      if (tag != kItem) fail("a sequence holds something else than items");
      if (size != kUndefined) need(end, size);
      items.push_back(elements(size == kUndefined ? end : at_ + size, size == kUndefined, how,
                               depth + 1, nullptr));
    }
    if (delimited) fail("a sequence has no end");
    return items;
  }

  // Items of compressed bytes up to a delimiter.
  bool fragments(std::size_t end, Encoding how) {
    while (end - at_ >= 8) {
      const std::uint32_t tag = next_tag(end, how), size = next32(end, how);
      if (tag == kSequenceEnd) return true;
      if (tag != kItem || size > end - at_) return false;
      at_ += size;
    }
    return false;
  }

  void pixels(std::size_t end, Encoding how, std::uint32_t length, DicomFile& file) {
    if (how.compressed) {
      file.pixels_complete = length == kUndefined && fragments(end, how);
    } else if (length <= end - at_) {
      file.pixels_complete = true;
      file.pixels = bytes_.substr(at_, length);
    }
  }

  std::string_view bytes_;
  std::size_t at_;
  bool meta_ = false;
};

std::string inflated(std::string_view packed) {
  z_stream stream{};
  if (inflateInit2(&stream, -15) != Z_OK) throw std::runtime_error("it can't be inflated");
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.data()));
  stream.avail_in = static_cast<uInt>(packed.size());
  std::string plain;
  std::vector<char> part(1 << 18);
  int status = Z_OK;
  while (status == Z_OK && plain.size() < kMostInflated) {
    stream.next_out = reinterpret_cast<Bytef*>(part.data());
    stream.avail_out = static_cast<uInt>(part.size());
    status = inflate(&stream, Z_NO_FLUSH);
    plain.append(part.data(), part.size() - stream.avail_out);
  }
  inflateEnd(&stream);
  if (status != Z_STREAM_END) throw std::runtime_error("its deflated part is not complete");
  return plain;
}

}  // namespace

std::string DicomItems::text(std::uint32_t tag) const {
  const auto found = elements.find(tag);
  if (found == elements.end()) return {};
  std::string text = trimmed(std::string(found->second.value));
  for (char& c : text)
    if (static_cast<unsigned char>(c) < 32) c = ' ';  // what is shown stays one line
  return text;
}

const std::vector<DicomItems>& DicomItems::sequence(std::uint32_t tag) const {
  static const std::vector<DicomItems> none;
  const auto found = elements.find(tag);
  return found == elements.end() ? none : found->second.items;
}

std::optional<int> DicomFile::number(std::uint32_t tag) const {
  const auto found = top.elements.find(tag);
  if (found == top.elements.end() || found->second.value.size() < 2) return {};
  const auto first = static_cast<unsigned char>(found->second.value[0]),
             second = static_cast<unsigned char>(found->second.value[1]);
  return big_endian ? first << 8 | second : second << 8 | first;
}

bool is_dicom_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::array<char, 132> head{};
  in.read(head.data(), head.size());
  return in && std::string_view(head.data() + 128, 4) == "DICM";
}

MappedFile::MappedFile(const std::string& path) {
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return;
  struct stat about {};
  if (fstat(file, &about) == 0 && S_ISREG(about.st_mode) && about.st_size > 0) {
    size_ = static_cast<std::size_t>(about.st_size);
    at_ = mmap(nullptr, size_, PROT_READ, MAP_PRIVATE, file, 0);
    if (at_ == MAP_FAILED) at_ = nullptr, size_ = 0;
  }
  close(file);
}

MappedFile::~MappedFile() {
  if (at_) munmap(at_, size_);
}

MappedFile& MappedFile::operator=(MappedFile&& other) noexcept {
  std::swap(at_, other.at_);
  std::swap(size_, other.size_);
  return *this;
}

void MappedFile::release(std::string_view part) const {
  const auto page = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
  const auto first = (reinterpret_cast<std::uintptr_t>(part.data()) + page - 1) / page * page;
  const auto last = reinterpret_cast<std::uintptr_t>(part.data() + part.size()) / page * page;
  if (at_ && first < last) madvise(reinterpret_cast<void*>(first), last - first, MADV_DONTNEED);
}

DicomFile parse_dicom(const std::string& path) {
  DicomFile file;
  file.file = MappedFile(path);
  std::string_view bytes = file.file.bytes();
  if (bytes.size() < 132) throw std::runtime_error("it can't be read");
  Parser head(bytes, 132);
  const std::string syntax = head.meta().text(kSyntax), uid = "1.2.840.10008.1.2";
  Encoding how;
  std::size_t at = head.at();
  if (syntax == uid) {
    how.implicit = true;
  } else if (syntax == uid + ".2") {
    how.big = true;
  } else if (syntax == uid + ".1.99") {
    file.inflated = inflated(bytes.substr(at));
    file.inflated.reserve(256);  // on the heap, so that the views survive a move
    bytes = file.inflated;
    at = 0;
  } else if (syntax == uid + ".5" || syntax.starts_with(uid + ".4.")) {
    how.compressed = true;
  } else if (syntax != uid + ".1") {
    throw std::runtime_error("its transfer syntax '" + syntax + "' is not known");
  }
  file.big_endian = how.big;
  file.compressed = how.compressed;
  Parser body(bytes, at);
  file.top = body.elements(bytes.size(), false, how, 0, &file);
  return file;
}

}  // namespace toothprep::image
