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
#include <vector>

namespace toothprep::image {

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

  std::string bytes;  // what all the views look at
};

bool is_dicom_file(const std::string& path);  // by its mark

// Throws std::runtime_error with the reason if the file can't be read or is damaged ahead of its
// pixels.
DicomFile parse_dicom(const std::string& path);

}  // namespace toothprep::image
