#include "toothprep/tools/batch/table_h5.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <utility>
#include <vector>

#include "toothprep/tools/batch/item_columns.h"
#include "toothprep/tools/files/table_file.h"
#include "toothprep/tools/io/plain_text.h"

namespace toothprep {
namespace {

// How names end, the longest first.
constexpr std::array<std::pair<const char*, const char*>, 30> kUnits = {{
    {"_n_s_per_mm", "N*s/mm"},
    {"_j_per_mm3", "J/mm^3"},
    {"_n_per_mm", "N/mm"},
    {"_mm_per_s", "mm/s"},
    {"_n_per_s", "N/s"},
    {"_j_mm3", "J/mm^3"},
    {"_mg_mm3", "mg/mm^3"},
    {"_n_s_mm", "N*s/mm"},
    {"_mm3_s", "mm^3/s"},
    {"_rev_s", "rev/s"},
    {"_mm_s", "mm/s"},
    {"_mg_s", "mg/s"},
    {"_percent", "%"},
    {"_n_mm", "N/mm"},
    {"_mnm", "mN*m"},
    {"_mm3", "mm^3"},
    {"_mm2", "mm^2"},
    {"_deg", "deg"},
    {"_mm", "mm"},
    {"_um", "um"},
    {"_mj", "mJ"},
    {"_hz", "Hz"},
    {"_us", "us"},
    {"_ms", "ms"},
    {"_mg", "mg"},
    {"_kg", "kg"},
    {"_n", "N"},
    {"_s", "s"},
    {"_j", "J"},
    {"_w", "W"},
}};

// A whole number that an int64 holds.
std::optional<std::int64_t> whole_number(const std::string& text) {
  std::int64_t value = 0;
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  if (text.empty() || error != std::errc() || stop != end) return {};
  return value;
}

// What the cells of a column have in common.
struct Kind {
  bool all = true, whole = true, numbers = true, truths = true;
  bool exact = true;  // whole numbers as float64, too
  std::size_t width = 1;

  void add(const std::string& cell) {
    width = std::max(width, TableFile::stored_text(cell).size());
    if (cell.empty()) {
      all = false;
      return;
    }
    truths = truths && (cell == "true" || cell == "false");
    numbers = numbers && decimal_number(cell).has_value();
    const auto value = whole_number(cell);
    whole = whole && value.has_value();
    constexpr std::int64_t kMost = std::int64_t{1} << 53;
    exact = exact && (!value || (*value >= -kMost && *value <= kMost));
  }

  [[nodiscard]] CellType type() const {
    if (truths) return all ? CellType::kTruth : CellType::kTruthOrNone;
    if (whole && all) return CellType::kWhole;
    // The digits of large whole numbers would be lost.
    return numbers && exact ? CellType::kNumber : CellType::kText;
  }
};

}  // namespace

std::string unit_of_key(const std::string& key) {
  std::vector<std::string> parts;
  for (std::size_t at = 0; at <= key.size();) {
    const std::size_t dot = std::min(key.find('.', at), key.size());
    parts.push_back(key.substr(at, dot - at));
    at = dot + 1;
  }
  // A tissue's share of what stands before it, or a criterion's value.
  static const std::vector<std::string> kOfTheWhole = {"enamel", "dentin", "pulp",       "other",
                                                       "total",  "value",  "uncertainty"};
  if (parts.size() > 1 &&
      std::find(kOfTheWhole.begin(), kOfTheWhole.end(), parts.back()) != kOfTheWhole.end())
    parts.pop_back();
  const std::string name = "_" + parts.back();
  for (const auto& [end, unit] : kUnits) {
    const std::string ending = end;
    if (name.size() > ending.size() &&
        name.compare(name.size() - ending.size(), ending.size(), ending) == 0)
      return unit;
  }
  return {};
}

void write_table_h5(const ItemRows& rows, const std::string& version, const std::string& build,
                    const std::string& path) {
  const ItemColumns columns(rows);
  std::vector<Kind> kinds(columns.names().size());
  for (const ItemRow& row : rows) {
    const std::vector<std::string> cells = columns.cells(row);
    for (std::size_t k = 0; k < cells.size(); ++k) kinds[k].add(cells[k]);
  }
  std::vector<TableColumn> table;
  for (std::size_t k = 0; k < kinds.size(); ++k) {
    const std::string& name = columns.names()[k];
    const CellType type =
        columns.is_text(k) || rows.size() == 0 ? CellType::kText : kinds[k].type();
    const bool measured = type == CellType::kNumber || type == CellType::kWhole;
    table.push_back({name, measured ? unit_of_key(name) : "", type, kinds[k].width});
  }
  TableFile file(path, "items",
                 {{"schema", "toothprep-batch"}, {"toothprep_version", version}, {"build", build}},
                 std::move(table), rows.size());
  for (const ItemRow& row : rows) file.add(columns.cells(row));
  file.close();
}

}  // namespace toothprep
