// The arguments of an item as a manifest has them.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "toothprep/step/core/strict_toml.h"

namespace toothprep {

// One or more texts, or a switch.
struct BatchArgument {
  std::vector<std::string> values;
  bool is_switch = false, on = false;
  std::string place;  // for errors
};
using BatchArguments = std::map<std::string, BatchArgument>;  // by option, with dashes

// Of the table; none without one. Throws InputError with `where` (the file) and `path` (the table's
// place in it).
BatchArguments read_arguments(const toml::table* table, const std::string& where,
                              const std::string& path);

// A text or number; nothing for what is neither.
std::optional<std::string> value_text_of(const toml::node& node);

std::string replaced(std::string text, const std::string& what, const std::string& by);

}  // namespace toothprep
