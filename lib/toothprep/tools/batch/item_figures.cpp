#include "toothprep/tools/batch/item_figures.h"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/regular_file.h"
#include "toothprep/tools/batch/item_columns.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/plain_text.h"
#include "toothprep/tools/io/write_file.h"

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

ItemRows::ItemRows(std::vector<ItemRow> rows) : count_(rows.size()) {
  row_ = [all = std::make_shared<const std::vector<ItemRow>>(std::move(rows))](std::size_t i) {
    return (*all)[i];
  };
}

namespace {

using Take = std::function<void(const std::string&)>;

void csv_to(const ItemRows& rows, const Take& take) {
  const ItemColumns columns(rows);
  const auto line = [&](const std::vector<std::string>& cells, bool head) {
    std::string csv;
    for (std::size_t k = 0; k < cells.size(); ++k) {
      const bool plain = !head && !columns.is_text(k) &&
                         (!columns.is_factor(k) || decimal_number(cells[k]).has_value());
      csv += (k > 0 ? "," : "") + (plain ? cells[k] : csv_cell(cells[k]));
    }
    take(csv + '\n');
  };
  line(columns.names(), true);
  for (const ItemRow& row : rows) line(columns.cells(row), false);
}

// The text of json_text() for the whole, a row at a time.
void json_to(const ItemRows& rows, const std::string& version, const std::string& build,
             const Take& take) {
  std::ptrdiff_t failed = 0, warned = 0;
  for (const ItemRow& row : rows) {
    failed += row.failed();
    warned += row.status == "done with warning";
  }
  Json json = {{"schema", "toothprep-batch"},
               {"schema_version", 1},
               {"toothprep_version", version},
               {"build", build},
               {"done", static_cast<std::ptrdiff_t>(rows.size()) - failed},
               {"done_with_warning", warned},
               {"failed", failed},
               {"items", Json::array()}};
  std::string head = json_text(json);
  if (rows.size() == 0) return take(head);
  head.erase(head.rfind("[]"));
  take(head + "[");
  bool next = false;
  for (const ItemRow& row : rows) {
    Json item = {{"name", row.name}, {"command", row.command}, {"status", row.status}};
    if (!row.reason.empty()) item["reason"] = row.reason;
    if (!row.step.empty()) item["step"] = row.step;
    if (!row.folder.empty() && row.folder != row.name) item["folder"] = row.folder;
    for (const auto& [name, value] : row.swept)
      item["sweep"][name] =
          decimal_number(value) ? Json::parse(value, nullptr, false) : Json(value);
    item["figures"] = Json::object();
    for (const auto& [key, value] : row.figures) item["figures"][key] = Json::parse(value);
    std::string text = json_text(item);
    text.pop_back();
    std::string indented;
    for (const char c : text) {
      indented += c;
      if (c == '\n') indented += "    ";
    }
    take((next ? ",\n    " : "\n    ") + indented);
    next = true;
  }
  take("\n  ]\n}\n");
}

// What it is given goes to a file.
class TextFile {
 public:
  explicit TextFile(const std::string& path) : path_(path), file_(std::fopen(path.c_str(), "wb")) {
    if (!file_) fail();
  }
  ~TextFile() {
    if (file_) std::fclose(file_);
  }
  TextFile(const TextFile&) = delete;
  TextFile& operator=(const TextFile&) = delete;
  void write(const std::string& text) {
    if (std::fwrite(text.data(), 1, text.size(), file_) != text.size()) fail();
  }
  void close() {
    std::FILE* file = std::exchange(file_, nullptr);
    if (std::fclose(file) != 0) fail();
  }

 private:
  [[noreturn]] void fail() const { throw Error(path_ + ": " + why_not_written(path_, errno)); }
  std::string path_;
  std::FILE* file_;
};

}  // namespace

std::string table_csv(const ItemRows& rows) {
  std::string csv;
  csv_to(rows, [&](const std::string& text) { csv += text; });
  return csv;
}

std::string table_json(const ItemRows& rows, const std::string& version, const std::string& build) {
  std::string json;
  json_to(rows, version, build, [&](const std::string& text) { json += text; });
  return json;
}

void write_table_csv(const ItemRows& rows, const std::string& path) {
  TextFile file(path);
  csv_to(rows, [&](const std::string& text) { file.write(text); });
  file.close();
}

void write_table_json(const ItemRows& rows, const std::string& version, const std::string& build,
                      const std::string& path) {
  TextFile file(path);
  json_to(rows, version, build, [&](const std::string& text) { file.write(text); });
  file.close();
}

}  // namespace toothprep
