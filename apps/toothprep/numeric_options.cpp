#include "numeric_options.h"

#include <algorithm>
#include <string>

#include "toothprep/tools/io/plain_text.h"

namespace toothprep::app {
namespace {

constexpr const char* kOrInfinity = "FLOAT|inf";

bool is_decimal_integer(const std::string& text) {
  const std::size_t first = !text.empty() && (text[0] == '-' || text[0] == '+') ? 1 : 0;
  const std::string digits = text.substr(first);
  return !digits.empty() && (digits[0] != '0' || digits.size() == 1) &&
         std::all_of(digits.begin(), digits.end(), [](char c) { return c >= '0' && c <= '9'; });
}

// Why `text` is not taken; empty if it is.
std::string objection(const std::string& text, bool integer, bool infinity) {
  if (infinity && (text == "inf" || text == "+inf")) return {};
  if (integer ? is_decimal_integer(text) : decimal_number(text).has_value()) return {};
  return "'" + text + "' is not " +
         (integer ? "a whole number in decimal digits" : "a finite decimal number") +
         (infinity ? ", nor inf" : "");
}

}  // namespace

void check_numbers(CLI::App& app) {
  for (CLI::Option* option : app.get_options()) {
    std::string type = option->get_type_name();  // a range stands behind it
    type.resize(std::min(type.size(), type.find(':')));
    const bool infinity = type == kOrInfinity;
    const bool real = type.find("FLOAT") != std::string::npos;
    const bool integer = type.find("INT") != std::string::npos;  // and UINT
    if (!real && !integer) continue;
    option->check([=](const std::string& text) { return objection(text, !real, infinity); });
  }
  for (CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; }))
    check_numbers(*sub);
}

CLI::Option* or_infinity(CLI::Option* option) { return option->type_name(kOrInfinity); }

}  // namespace toothprep::app
