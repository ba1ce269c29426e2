#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <string_view>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/input_file.h"
#include "toothprep/tools/io/memory_limit.h"
#include "toothprep/tools/recordings/device_log.h"
#include "toothprep/tools/recordings/recorded_table.h"
#include "toothprep/tools/trajectory/trajectory.h"

namespace toothprep {
namespace {

constexpr std::uint64_t kLargestFile = std::uint64_t{4} << 30;
constexpr std::size_t kLongestLine = 1 << 16, kMostColumns = 2000;
constexpr std::size_t kLooked = 400;                    // lines by which the form is recognised
constexpr std::int64_t kExact = std::int64_t{1} << 53;  // whole numbers that a double holds
const double kNone = std::numeric_limits<double>::quiet_NaN();

using Fields = std::vector<std::string_view>;

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t\r");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

// UTF-16 (spreadsheets' "Unicode text") as UTF-8; other bytes without their byte order mark.
std::string as_utf8(std::string bytes) {
  const auto at = [&](std::size_t i) { return static_cast<unsigned char>(bytes[i]); };
  if (bytes.size() >= 3 && at(0) == 0xef && at(1) == 0xbb && at(2) == 0xbf) return bytes.substr(3);
  const bool little = bytes.size() >= 2 && at(0) == 0xff && at(1) == 0xfe;
  const bool big = bytes.size() >= 2 && at(0) == 0xfe && at(1) == 0xff;
  if (!little && !big) return bytes;
  std::string text;
  for (std::size_t i = 2; i + 1 < bytes.size(); i += 2) {
    const unsigned unit = little ? at(i) | at(i + 1) << 8u : at(i) << 8u | at(i + 1);
    if (unit < 0x80) {
      text += static_cast<char>(unit);
    } else if (unit < 0x800) {
      text += static_cast<char>(0xc0 | unit >> 6u);
      text += static_cast<char>(0x80 | (unit & 0x3fu));
    } else {  // names of columns hold no surrogates that matter
      text += static_cast<char>(0xe0 | unit >> 12u);
      text += static_cast<char>(0x80 | (unit >> 6u & 0x3fu));
      text += static_cast<char>(0x80 | (unit & 0x3fu));
    }
  }
  return text;
}

// A line of the file that is not blank.
struct Line {
  std::string_view text;
  std::uint32_t number = 0;  // from 1
  bool comment = false;      // text: behind the sign
};

std::vector<Line> lines_of(std::string_view text, const std::string& path) {
  std::vector<Line> lines;
  std::uint32_t number = 0;
  while (!text.empty()) {
    ++number;
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view line = trimmed(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
    if (line.size() > kLongestLine)
      throw InputError(path, fmt::format("line {}", number), "is longer than 64 kB",
                       "this is not a table");
    if (line.find('\0') != std::string_view::npos)
      throw InputError(path, fmt::format("line {}", number), "holds a zero byte",
                       "this is not a table of text");
    if (line.empty()) continue;
    const std::size_t sign = line.starts_with("//") ? 2 : line[0] == '#' || line[0] == '%' ? 1 : 0;
    lines.push_back({sign ? trimmed(line.substr(sign)) : line, number, sign > 0});
  }
  return lines;
}

// How the lines are divided: a character, or blanks for 0.
struct Form {
  char separator = ',';
  bool decimal_comma = false;
};

void split(std::string_view line, char separator, Fields& fields) {
  fields.clear();
  while (true) {
    if (separator == 0) {
      line = trimmed(line);
      if (line.empty() && !fields.empty()) return;
    }
    const std::string_view start = trimmed(line);
    std::size_t end = 0;
    if (!start.empty() && start[0] == '"') {  // a quoted field may hold the separator
      const std::size_t opens = line.find('"');
      const std::size_t closes = line.find('"', opens + 1);
      if (closes != std::string_view::npos) end = closes;
    }
    end = separator ? line.find(separator, end) : line.find_first_of(" \t", end);
    std::string_view field = trimmed(line.substr(0, end));
    if (field.size() >= 2 && field.front() == '"' && field.back() == '"')
      field = trimmed(field.substr(1, field.size() - 2));
    fields.push_back(field);
    if (end == std::string_view::npos) return;
    line.remove_prefix(end + 1);
  }
}

bool says_nothing(std::string_view field) {
  static const std::array<std::string_view, 9> kWords = {"",    "nan",  "NaN", "NAN", "NA",
                                                         "n/a", "null", "-",   "None"};
  return std::find(kWords.begin(), kWords.end(), field) != kWords.end();
}

// A number, NaN for a field that says nothing; none for a text.
std::optional<double> number_in(std::string_view field, bool decimal_comma) {
  if (says_nothing(field)) return kNone;
  std::array<char, 64> copy{};
  if (field[0] == '+') field.remove_prefix(1);
  if (decimal_comma) {
    if (field.size() >= copy.size()) return {};
    std::replace_copy(field.begin(), field.end(), copy.begin(), ',', '.');
    if (std::count(field.begin(), field.end(), '.')) return {};
    field = std::string_view(copy.data(), field.size());
  }
  double value = 0;
  const auto [stop, error] = std::from_chars(field.data(), field.data() + field.size(), value);
  if (error != std::errc() || stop != field.data() + field.size()) return {};
  return std::isfinite(value) ? value : kNone;
}

// Digits only, and too large for a double.
std::optional<std::int64_t> long_integer(std::string_view field) {
  std::int64_t value = 0;
  const auto [stop, error] = std::from_chars(field.data(), field.data() + field.size(), value);
  if (error != std::errc() || stop != field.data() + field.size()) return {};
  return value > kExact || value < -kExact ? std::optional(value) : std::nullopt;
}

// Seconds of "12:30:01.5" (also 12:30:01,5) or "2026-11-22T12:30:01.5Z".
std::optional<double> clock_seconds(std::string_view field) {
  double days = 0;
  if (field.size() > 10 && field[4] == '-' && field[7] == '-') {
    int year = 0, month = 0, day = 0;
    std::from_chars(field.data(), field.data() + 4, year);
    std::from_chars(field.data() + 5, field.data() + 7, month);
    std::from_chars(field.data() + 8, field.data() + 10, day);
    if (year < 1900 || month < 1 || month > 12 || day < 1 || day > 31) return {};
    const int y = month > 2 ? year : year - 1, m = month > 2 ? month - 3 : month + 9;
    const int whole = 365 * y + y / 4 - y / 100 + y / 400 + (153 * m + 2) / 5 + day;
    days = whole;
    field.remove_prefix(11);
  }
  if (!field.empty() && field.back() == 'Z') field.remove_suffix(1);
  std::array<double, 3> part{};
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t colon = field.find(':');
    if ((colon == std::string_view::npos) != (i == 2)) return {};
    const std::string_view piece = field.substr(0, colon);
    const auto value = piece.empty()
                           ? std::nullopt
                           : number_in(piece, i == 2 && piece.find(',') != std::string_view::npos);
    if (!value || !(*value >= 0 && *value < (i ? 61 : 24))) return {};
    part[i] = *value;
    if (i < 2) field.remove_prefix(colon + 1);
  }
  return ((days * 24 + part[0]) * 60 + part[1]) * 60 + part[2];
}

std::size_t numbers_in(const Fields& fields, bool decimal_comma) {
  return static_cast<std::size_t>(
      std::count_if(fields.begin(), fields.end(), [&](std::string_view f) {
        const auto value = number_in(f, decimal_comma);
        return value && !std::isnan(*value);
      }));
}

// The form that makes most numbers of the lines.
Form recognise_form(const std::vector<Line>& lines) {
  static const std::array<Form, 7> kForms = {Form{'\t', false}, Form{'\t', true}, Form{';', false},
                                             Form{';', true},   Form{',', false}, Form{0, false},
                                             Form{0, true}};
  Form best;
  double most = -1;
  Fields fields;
  for (const Form& form : kForms) {
    std::size_t numbers = 0, all = 0, looked = 0;
    // From the end, where no preamble stands.
    for (std::size_t i = lines.size(); i-- > 0 && looked < kLooked;) {
      if (lines[i].comment) continue;
      ++looked;
      split(lines[i].text, form.separator, fields);
      if (fields.size() < 2) continue;
      numbers += numbers_in(fields, form.decimal_comma);
      all += fields.size();
    }
    // Fields that are no numbers count against a form: "1,5;2" by commas has one.
    const double merit = 2.0 * static_cast<double>(numbers) - static_cast<double>(all);
    if (numbers > 0 && merit > most) most = merit, best = form;
  }
  return best;
}

// How many fields the rows have: the most frequent count of the last lines.
std::size_t width_of(const std::vector<Line>& lines, const Form& form) {
  std::vector<std::size_t> counts;
  Fields fields;
  for (std::size_t i = lines.size(); i-- > 0 && counts.size() < kLooked;) {
    if (lines[i].comment) continue;
    split(lines[i].text, form.separator, fields);
    counts.push_back(fields.size());
  }
  std::sort(counts.begin(), counts.end());
  std::size_t width = 0, most = 0;
  for (std::size_t i = 0, run = 0; i < counts.size(); ++i) {
    run = i > 0 && counts[i] == counts[i - 1] ? run + 1 : 1;
    if (run >= most) most = run, width = counts[i];
  }
  return width;
}

bool is_data(const Fields& fields, std::size_t width, bool decimal_comma) {
  return fields.size() == width &&
         numbers_in(fields, decimal_comma) >= std::min<std::size_t>(2, width);
}

bool is_text(const Fields& fields, bool decimal_comma) {
  return !fields.empty() && numbers_in(fields, decimal_comma) == 0;
}

// "(mm)", "[N]", "s": what stands in a line of units. Blank is none.
bool is_unit(std::string_view field) {
  static const std::array<std::string_view, 22> kUnits = {
      "",  "s",  "ms", "us",  "ns", "sec", "mm",  "cm",  "m",   "um", "in",
      "N", "mN", "gf", "kgf", "g",  "deg", "rad", "rpm", "1/s", "Hz", "-"};
  if (field.size() > 1 && (field.front() == '(' || field.front() == '[')) return true;
  return std::find(kUnits.begin(), kUnits.end(), field) != kUnits.end();
}

struct Head {
  std::size_t first_row = 0;  // index of its line
  std::vector<std::string> names;
};

// The header's names for `width` columns; numbers where there is no header.
std::vector<std::string> names_above(const std::vector<Line>& lines, std::size_t first_row,
                                     std::size_t width, const Form& form, RecordedTable& table) {
  std::vector<std::string> names;
  std::vector<std::string_view> units;
  Fields fields;
  for (std::size_t i = first_row; i-- > 0 && names.empty();) {
    split(lines[i].text, form.separator, fields);
    if (!is_text(fields, form.decimal_comma)) continue;
    if (const auto log = device_log_names(fields); log && log->size() == width) {
      set_device_log_conventions(table);
      return *log;
    }
    if (fields.size() != width) continue;
    const bool all_units = std::all_of(fields.begin(), fields.end(), is_unit);
    if (all_units && units.empty() && i > 0) {
      units = fields;
      continue;
    }
    for (const std::string_view name : fields) names.emplace_back(name);
  }
  if (names.empty())
    for (std::size_t c = 1; c <= width; ++c) names.push_back(std::to_string(c));
  for (std::size_t c = 0; c < units.size(); ++c) {
    if (units[c].empty()) continue;
    const bool enclosed = units[c].front() == '(' || units[c].front() == '[';
    names[c] += enclosed ? " " + std::string(units[c]) : " (" + std::string(units[c]) + ")";
  }
  return names;
}

std::size_t first_row_of(const std::vector<Line>& lines, std::size_t width, const Form& form) {
  Fields fields;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    if (lines[i].comment) continue;
    split(lines[i].text, form.separator, fields);
    if (is_data(fields, width, form.decimal_comma)) return i;
  }
  return lines.size();
}

// A column as it is filled.
struct Column {
  bool has_number = false, has_text = false, has_clock = false;
  std::optional<std::int64_t> base;  // of whole numbers that a double can't hold
  std::size_t first_text = 0;        // row
};

double value_of(std::string_view field, const Form& form, Column& column, std::size_t row) {
  if (const auto large = long_integer(field)) {
    if (!column.base) column.base = *large;
    column.has_number = true;
    return static_cast<double>(*large - *column.base);
  }
  if (const auto value = number_in(field, form.decimal_comma)) {
    column.has_number = column.has_number || !std::isnan(*value);
    return *value;
  }
  if (const auto clock = clock_seconds(field)) {
    column.has_clock = true;
    return *clock;
  }
  if (!column.has_text) column.first_text = row;
  column.has_text = true;
  return kNone;
}

std::string name_of_separator(const Form& form) {
  const std::string by = form.separator == '\t'  ? "tabs"
                         : form.separator == ';' ? "semicolons"
                         : form.separator == ',' ? "commas"
                                                 : "blanks";
  return "table separated by " + by + (form.decimal_comma ? ", decimal commas" : "");
}

void check_columns(const std::vector<Column>& columns, RecordedTable& table,
                   const std::string& path) {
  for (std::size_t c = 0; c < columns.size(); ++c) {
    const Column& column = columns[c];
    if (column.has_number && (column.has_text || column.has_clock))
      throw InputError(path, table.place(column.first_text) + ", column " + table.names[c],
                       "is no number, where other rows have one", "is the line complete?");
    if (column.has_text)
      table.notes.push_back("column '" + table.names[c] + "' holds text and is left out");
    if (column.has_clock)
      table.notes.push_back("column '" + table.names[c] + "' holds clock times, read as seconds");
  }
}

}  // namespace

std::string RecordedTable::place(std::size_t row) const {
  return row < lines.size() ? fmt::format("line {}", lines[row]) : fmt::format("row {}", row);
}

RecordedTable read_text_table(const std::string& path) {
  const std::string text = as_utf8(bytes_of_file(path, kLargestFile));
  const std::vector<Line> lines = lines_of(text, path);
  if (lines.empty()) throw InputError(path, "", "is empty", "a table of numbers is needed");
  const Form form = recognise_form(lines);
  const std::size_t width = width_of(lines, form);
  const std::size_t first = first_row_of(lines, width, form);
  if (width < 2 || width > kMostColumns || first + 1 >= lines.size())
    throw InputError(path, "", "is not a table with numbers in it",
                     "two lines of numbers in equal columns are needed at least");
  const std::size_t most_rows = lines.size() - first;
  if (most_rows > kMostSamples)
    throw InputError(path, "", fmt::format("more than {} samples", kMostSamples),
                     "cut the recording into pieces");
  require_memory(path, "", static_cast<double>(most_rows * width * sizeof(double)),
                 "cut the recording into pieces");

  RecordedTable table;
  table.kind = name_of_separator(form);
  table.names = names_above(lines, first, width, form, table);
  std::vector<Column> columns(width);
  table.columns.resize(width);
  Fields fields;
  for (std::size_t i = first; i < lines.size(); ++i) {
    if (lines[i].comment) continue;
    split(lines[i].text, form.separator, fields);
    if (fields.size() != width)
      throw InputError(path, fmt::format("line {}", lines[i].number),
                       fmt::format("has {} columns where the others have {}", fields.size(), width),
                       "is the file complete?");
    for (std::size_t c = 0; c < width; ++c)
      table.columns[c].push_back(value_of(fields[c], form, columns[c], table.lines.size()));
    table.lines.push_back(lines[i].number);
  }
  if (table.rows() < 2)
    throw InputError(path, "", "holds fewer than two samples", "record a motion");
  check_columns(columns, table, path);
  return table;
}

}  // namespace toothprep
