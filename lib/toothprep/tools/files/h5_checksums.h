// A list of what a file holds with a SHA-256 of each: a text, one line each, sorted:
//
//   PATH TYPE SHAPE SHA256           of a dataset:    /handle/position f8 3060x3 5a1b...
//   PATH@NAME TYPE SHAPE SHA256      of an attribute: /handle/position@units text 1 77c0...
//   end SHA256                       of the lines above, with their line ends
//
// TYPE is f8, u1, u4, i4, i8 or text, SHAPE 1 for a single value. The hash is over the values as they
// are stored, little endian, unpacked, row by row; of texts over their characters, with a line end
// between them. So packing a file anew changes nothing, what somebody adds doesn't either, and what
// isn't as it was is known by its name.
//
// Callers hold lock_hdf5().
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "toothprep/tools/files/hdf5_handle.h"

namespace toothprep::h5 {

constexpr const char* kChecksums = "checksums";                // of all, when a file is finished
constexpr const char* kChecksumsOfHead = "checksums_of_head";  // of what stands at its start

// The line without its end; nothing if the object can't be read, or is of another type.
std::optional<std::string> attribute_line(Id file, const std::string& path,
                                          const std::string& name);
// `announce` hears the number of values before they are read.
std::optional<std::string> dataset_line(Id file, const std::string& path,
                                        const std::function<void(std::size_t)>& announce);
// The same of values that are at hand.
std::string dataset_line(const std::string& path, Id type, const std::vector<std::uint64_t>& shape,
                         const std::string& sha256);

std::string checksum_list(const std::set<std::string>& lines);

// What isn't as the list says ("/time", "attribute bur"); the list itself if it isn't whole.
std::vector<std::string> differing(Id file, const std::string& list,
                                   const std::function<void(std::size_t)>& announce);

}  // namespace toothprep::h5
