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
  std::string name, command, status, reason;  // status: "done" or "failed"
  ItemFigures figures;
};

// Rows in their order; columns name, command, status, reason, then the figures' keys as they are
// first seen. Quoted as RFC 4180 has it. Both end up whole or not at all.
std::string table_csv(const std::vector<ItemRow>& rows);
std::string table_json(const std::vector<ItemRow>& rows, const std::string& version,
                       const std::string& build);

}  // namespace toothprep
