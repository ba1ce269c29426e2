// Numbers as text, the same in every locale. What has a fixed number of digits is fmt::format's job.
#pragma once

#include <array>
#include <charconv>
#include <string>

namespace toothprep {

// The shortest decimal that reads back as the same number.
template <class Number>
std::string shortest_text(Number value) {
  std::array<char, 32> digits;
  const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
  return {digits.data(), end};
}

// "0.00" for "-0.00": a rounded number has no sign where its digits are all zero.
inline std::string without_negative_zero(std::string number) {
  if (number.starts_with('-') && number.find_first_of("123456789") == std::string::npos)
    number.erase(0, 1);
  return number;
}

}  // namespace toothprep
