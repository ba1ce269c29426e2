// The elements of a DICOM file (PS3.5, section 7, and PS3.10), read strictly: every length has to
// fit into what holds it. GDCM, as it is packaged, ends the whole program by an assertion when it
// meets a damaged file, so it is only given files that went through here, and only compressed ones.
//
// Little and big endian, explicit and implicit, deflated; not the files of before 1993 that lack
// the "DICM" mark.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace toothprep::image {

// A file's bytes as the system pages them in, so that a header costs no more than itself.
class MappedFile {
 public:
  MappedFile() = default;
  explicit MappedFile(const std::string& path);  // empty if it can't be read
  ~MappedFile();
  MappedFile(MappedFile&& other) noexcept { *this = std::move(other); }
  MappedFile& operator=(MappedFile&& other) noexcept;
  std::string_view bytes() const { return {static_cast<const char*>(at_), size_}; }
  // Part of bytes() isn't looked at again soon and need not stay in memory.
  void release(std::string_view part) const;

 private:
  void* at_ = nullptr;
  std::size_t size_ = 0;
};

struct DicomItems;

struct DicomElement {
  std::string_view value;
  std::vector<DicomItems> items;  // of a sequence
};

struct DicomItems {
  std::map<std::uint32_t, DicomElement> elements;  // by group and element, 0xggggeeee

  std::string text(std::uint32_t tag) const;  // one line, trimmed; empty if absent
  const std::vector<DicomItems>& sequence(std::uint32_t tag) const;
};

struct DicomFile {
  DicomItems top;
  bool big_endian = false;
  bool compressed = false;  // the pixels are in fragments
  bool pixels_complete = false;
  std::string_view pixels;  // if complete and not compressed

  // A 16-bit number at the top.
  std::optional<int> number(std::uint32_t tag) const;

  // What all the views look at: the file, or what it inflates to.
  MappedFile file;
  std::string inflated;
};

bool is_dicom_file(const std::string& path);  // by its mark

// Throws std::runtime_error with the reason if the file can't be read or is damaged ahead of its
// pixels.
DicomFile parse_dicom(const std::string& path);

}  // namespace toothprep::image
