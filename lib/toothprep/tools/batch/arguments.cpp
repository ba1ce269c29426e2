#include "toothprep/tools/batch/arguments.h"

#include <algorithm>

#include "toothprep/step/core/number_text.h"

namespace toothprep {

std::string replaced(std::string text, const std::string& what, const std::string& by) {
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += by.size())
    text.replace(at, what.size(), by);
  return text;
}

std::optional<std::string> value_text_of(const toml::node& node) {
  if (const auto* text = node.as_string()) return text->get();
  if (const auto* integer = node.as_integer()) return std::to_string(integer->get());
  if (const auto* real = node.as_floating_point()) return shortest_text(real->get());
  return {};
}

BatchArguments read_arguments(const toml::table* table, const std::string& where,
                              const std::string& path) {
  BatchArguments arguments;
  if (!table) return arguments;
  for (const auto& [key, node] : *table) {
    std::string option(key.str());
    std::replace(option.begin(), option.end(), '_', '-');
    BatchArgument a;
    a.place = path + "." + std::string(key.str()).substr(0, 60);
    if (const auto* flag = node.as_boolean()) {
      a.is_switch = true;
      a.on = flag->get();
    } else if (const auto value = value_text_of(node)) {
      a.values = {*value};
    } else if (const toml::array* list = node.as_array(); list && !list->empty()) {
      bool numbers = true;
      std::string joined;
      for (const toml::node& entry : *list) {
        const auto text = value_text_of(entry);
        if (!text) throw InputError(where, a.place, "must hold numbers or texts only");
        numbers = numbers && !entry.is_string();
        joined += (joined.empty() ? "" : ",") + *text;
        a.values.push_back(*text);
      }
      if (numbers) a.values = {joined};  // a list of numbers is one value with commas
    } else {
      throw InputError(where, a.place,
                       "must be a text, a number, true or false, or a list of them");
    }
    if (!arguments.emplace(option, std::move(a)).second)
      throw InputError(where, path + "." + std::string(key.str()), "is given twice, with _ and -");
  }
  return arguments;
}

}  // namespace toothprep
