// Text from outside (names, metadata, options) on its way to a terminal or a table, and numbers in
// it.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace toothprep {

// A finite number in decimal digits and nothing else ("1.2", "-3e-4"); none for "nan", "inf",
// "1e400", "0x10", "1.2 mm" or "".
std::optional<double> decimal_number(std::string_view text);

// What a terminal may be given: control characters other than line ends and tabs (escape sequences
// begin with one), characters that reverse the direction of writing, and bytes that are not UTF-8
// as \x1b and the like. Other text comes back as it is.
std::string terminal_text(std::string_view text);

// A cell of a CSV file: in quotes where it holds a comma, a quote or a line end, and with an
// apostrophe before what a spreadsheet would take for a formula (= + - @, tab). For text only: a
// number may begin with a minus.
std::string csv_cell(std::string_view text);

}  // namespace toothprep
