// JSON as text. A template, so that this module needs no JSON library.
#pragma once

#include <string>

namespace toothprep {

// A JSON value as indented lines, valid whatever its strings hold: bytes that are not UTF-8 (a file
// name may have them) become U+FFFD.
template <class Json>
std::string json_text(const Json& value) {
  return value.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace toothprep
