// The figures of one item, and the table of all of them.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace toothprep {

// Key and value as JSON writes it: a number, true or false. In the JSON's order.
using ItemFigures = std::vector<std::pair<std::string, std::string>>;

// Every number and truth value of a JSON file: nested keys joined by dots, entries of a list by
// their member `key` (other lists, texts and nulls are passed over). Keys that begin with one of
// `unrepeatable` are left out. Throws InputError for what is no JSON object.
ItemFigures read_figures(const std::string& path, const std::vector<std::string>& unrepeatable);

struct ItemRow {
  // status: "done", "done with warning" or "failed"; reason: of the failure, or the warnings
  std::string name, command, status, reason;
  ItemFigures figures;

  [[nodiscard]] bool failed() const { return status == "failed"; }
  // The figure as it stands there; empty if it is none of the item's.
  [[nodiscard]] std::string figure(const std::string& key) const;
};

// Rows in their order; columns name, status, of scores points_percent and passed, then command,
// reason, and the other figures' keys as they are first seen. Quoted as RFC 4180 has it.
std::string table_csv(const std::vector<ItemRow>& rows);
std::string table_json(const std::vector<ItemRow>& rows, const std::string& version,
                       const std::string& build);

}  // namespace toothprep
