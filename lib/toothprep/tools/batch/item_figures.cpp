#include "toothprep/tools/batch/item_figures.h"

#include <algorithm>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/regular_file.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/plain_text.h"

namespace toothprep {
namespace {

using Json = nlohmann::ordered_json;

void collect(const Json& node, const std::string& key, const std::vector<std::string>& unrepeatable,
             ItemFigures& figures) {
  for (const std::string& beginning : unrepeatable)
    if (key.rfind(beginning, 0) == 0) return;
  const std::string prefix = key.empty() ? "" : key + ".";
  if (node.is_object()) {
    for (const auto& [name, value] : node.items())
      collect(value, prefix + name, unrepeatable, figures);
  } else if (node.is_array()) {
    for (const Json& entry : node)
      if (entry.is_object() && entry.contains("key") && entry["key"].is_string())
        collect(entry, prefix + entry["key"].get<std::string>(), unrepeatable, figures);
  } else if (node.is_number() || node.is_boolean()) {
    // The first of equal keys stands.
    if (std::none_of(figures.begin(), figures.end(), [&](const auto& f) { return f.first == key; }))
      figures.push_back({key, node.dump()});
  }
}

}  // namespace

ItemFigures read_figures(const std::string& path, const std::vector<std::string>& unrepeatable) {
  regular_file_size(path);
  std::ifstream in(path, std::ios::binary);
  if (!in) throw InputError(path, "", "cannot be read");
  const Json json = Json::parse(in, nullptr, false);
  if (!json.is_object()) throw InputError(path, "", "is no JSON object");
  ItemFigures figures;
  collect(json, "", unrepeatable, figures);
  return figures;
}

std::string ItemRow::figure(const std::string& key) const {
  for (const auto& [own, value] : figures)
    if (own == key) return value;
  return {};
}

std::string table_csv(const std::vector<ItemRow>& rows) {
  std::vector<std::string> first, columns;
  for (const char* key : {"points_percent", "passed"})
    if (std::any_of(rows.begin(), rows.end(),
                    [&](const ItemRow& row) { return !row.figure(key).empty(); }))
      first.emplace_back(key);
  std::map<std::string, std::size_t> place;
  for (const std::string& key : first) place.emplace(key, 0);
  for (const ItemRow& row : rows)
    for (const auto& [key, value] : row.figures)
      if (place.emplace(key, columns.size()).second) columns.push_back(key);
  std::string csv = "name,status";
  for (const std::string& key : first) csv += "," + key;
  csv += ",command,reason";
  for (const std::string& column : columns) csv += "," + csv_cell(column);
  csv += '\n';
  for (const ItemRow& row : rows) {
    csv += csv_cell(row.name) + "," + row.status;
    for (const std::string& key : first) csv += "," + row.figure(key);
    csv += "," + row.command + "," + csv_cell(row.reason);
    std::vector<std::string> cells(columns.size());
    for (const auto& [key, value] : row.figures)
      if (std::find(first.begin(), first.end(), key) == first.end()) cells[place[key]] = value;
    for (const std::string& cell : cells) csv += "," + cell;
    csv += '\n';
  }
  return csv;
}

std::string table_json(const std::vector<ItemRow>& rows, const std::string& version,
                       const std::string& build) {
  Json json = {{"schema", "toothprep-batch"},
               {"schema_version", 1},
               {"toothprep_version", version},
               {"build", build}};
  const auto failed =
      std::count_if(rows.begin(), rows.end(), [](const ItemRow& row) { return row.failed(); });
  json["done"] = static_cast<std::ptrdiff_t>(rows.size()) - failed;
  json["done_with_warning"] = std::count_if(rows.begin(), rows.end(), [](const ItemRow& row) {
    return row.status == "done with warning";
  });
  json["failed"] = failed;
  json["items"] = Json::array();
  for (const ItemRow& row : rows) {
    Json item = {{"name", row.name}, {"command", row.command}, {"status", row.status}};
    if (!row.reason.empty()) item["reason"] = row.reason;
    item["figures"] = Json::object();
    for (const auto& [key, value] : row.figures) item["figures"][key] = Json::parse(value);
    json["items"].push_back(std::move(item));
  }
  return json_text(json);
}

}  // namespace toothprep
