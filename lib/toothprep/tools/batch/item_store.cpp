#include "toothprep/tools/batch/item_store.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <system_error>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/hash.h"
#include "toothprep/tools/io/json_text.h"
#include "toothprep/tools/io/outputs.h"
#include "toothprep/tools/io/part.h"
#include "toothprep/tools/io/rename.h"
#include "toothprep/tools/io/write_file.h"

namespace toothprep {
namespace {
namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr const char* kSchema = "toothprep-batch-item";

std::string sha256_of(const std::string& text) {
  Sha256 hash;
  hash.update(text.data(), text.size());
  return hash.hex();
}

Json read_json(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return in ? Json::parse(in, nullptr, false) : Json();
}

// item.json of an item that a batch wrote; null otherwise.
Json item_record(const fs::path& folder) {
  Json record = read_json(folder / "item.json");
  if (!record.is_object() || !record.contains("schema") || record["schema"] != kSchema) return {};
  return record;
}

// Every file below the folder but the batch's own, with its hash, sorted by name.
Json outputs_of(const fs::path& folder) {
  Json outputs = Json::object();
  for (const LedgerFile& file : files_now(folder))
    if (file.name != "item.json" && file.name != "log.txt")
      outputs[file.name] = sha256_of_file((folder / file.name).string());
  return outputs;
}

// The first file below an item's folder that its record doesn't name.
std::string foreign_file(const fs::path& folder, const Json& record) {
  const Json outputs = record.value("outputs", Json::object());
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    std::string name = entry.path().lexically_relative(folder).string();
    const bool ours = entry.is_directory() || name == "item.json" || name == "log.txt" ||
                      (outputs.is_object() && outputs.contains(name));
    if (entry.is_symlink() || !ours) return name;
  }
  return {};
}

// Why the folder can't be replaced; empty if it can.
std::string not_replaceable(const fs::path& folder) {
  std::error_code error;
  const fs::file_status status = fs::symlink_status(folder, error);
  if (!fs::exists(status)) return {};
  const Json record = fs::is_directory(status) ? item_record(folder) : Json();
  if (record.is_null()) return "was not written by a batch";
  const std::string name = foreign_file(folder, record);
  return name.empty() ? "" : "holds '" + name + "', which no batch wrote";
}

// "first warning", or "first warning (and 2 more)"; empty if the log has none.
std::string warnings_of(const fs::path& log) {
  const std::string beginning = "warning: ";
  std::ifstream in(log, std::ios::binary);
  std::string line, first;
  int more = 0;
  while (std::getline(in, line)) {
    if (line.rfind(beginning, 0) != 0) continue;
    if (first.empty())
      first = line.substr(beginning.size(), 1000);
    else
      ++more;
  }
  return more > 0 ? first + " (and " + std::to_string(more) + " more)" : first;
}

std::string host_name() {
  std::array<char, 256> name{};
  gethostname(name.data(), name.size() - 1);
  return name.data();
}

}  // namespace

std::string ItemStore::last_line(const fs::path& log) {
  std::ifstream in(log, std::ios::binary);
  std::string line, last;
  while (std::getline(in, line)) {
    while (!line.empty() && (line.back() == '\r' || line.back() == ' ')) line.pop_back();
    if (!line.empty()) last = line.substr(0, 1000);
  }
  // The program puts its name before an error.
  const std::string name = "toothprep: ";
  return last.rfind(name, 0) == 0 ? last.substr(name.size()) : last;
}

std::string ItemStore::path_of(const BatchInput& input) const {
  return input.item ? (folder_of(*input.item) / input.path).string() : input.path;
}

std::string ItemStore::hash_of(const BatchInput& input) {
  if (input.item) {
    // A folder's hash is that of its files' names and hashes.
    std::string whole;
    if (const auto entry = last(*input.item))
      for (const auto& [name, hash] : entry->outputs) {
        if (name == input.path) return hash;
        if (name.rfind(input.path + "/", 0) == 0) whole += name + " " + hash + "\n";
      }
    return whole.empty() ? "" : sha256_of(whole);
  }
  const auto [place, fresh] = hashes_.try_emplace(input.path);
  if (!fresh) return place->second;
  if (!fs::is_directory(input.path)) return place->second = sha256_of_file(input.path);
  std::string whole;
  for (const LedgerFile& file : files_now(input.path))
    whole += file.name + " " + sha256_of_file((fs::path(input.path) / file.name).string()) + "\n";
  return place->second = sha256_of(whole);
}

std::string ItemStore::identity_of(std::size_t i) {
  const BatchItem& item = m_.items[i];
  const BatchCommand& command = m_.commands[item.command];
  Json line = Json::array({command.name});
  for (const auto* list : {&command.always, &item.shown})
    for (const std::string& argument : *list) line.push_back(argument);
  Json inputs = Json::object();
  for (const BatchInput& input : item.inputs) inputs[input.shown] = hash_of(input);
  Json identity = {{"command", line}, {"inputs", inputs}, {"toothprep_version", version_}};
  for (const BatchFill& fill : item.fills)
    identity["filled"][fill.file] = sha256_of(filled_text(m_, item, m_.texts[fill.text]));
  return identity.dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::optional<LedgerEntry> ItemStore::last(std::size_t i, bool figures) const {
  std::optional<LedgerEntry> found;
  for (LedgerEntry& entry : ledger_.entries(m_.items[i].name, figures))
    if (unchanged(folder_of(i), entry.files)) found = std::move(entry);
  if (const auto own = found_.find(i);
      !found && own != found_.end() && unchanged(folder_of(i), own->second.files))
    found = own->second;
  return found;
}

// From item.json, all hashes checked.
std::optional<LedgerEntry> ItemStore::read_folder(std::size_t i,
                                                  const std::string& identity) const {
  const fs::path folder = folder_of(i);
  const BatchCommand& command = m_.commands[m_.items[i].command];
  try {
    const Json record = item_record(folder), wanted = Json::parse(identity);
    if (record.is_null()) return {};
    for (const auto& [key, value] : wanted.items())
      if (!record.contains(key) || record[key] != value) return {};
    LedgerEntry entry;
    entry.identity = sha256_of(identity);
    entry.seconds = record.value("seconds", 0.0);
    entry.files = files_now(folder);
    entry.failed = record.value("status", "") == "failed";
    if (entry.failed) {
      entry.reason = record.value("reason", "");
      return entry;
    }
    const Json outputs = outputs_of(folder);
    if (record.value("status", "") != "done" || record.value("outputs", Json()) != outputs)
      return {};
    for (const auto* list : {"outputs", "dropped"})
      if (record.contains(list))
        for (const auto& [name, hash] : record[list].items())
          entry.outputs.emplace_back(name, hash.get<std::string>());
    std::sort(entry.outputs.begin(), entry.outputs.end());
    entry.reason = warnings_of(folder / "log.txt");
    if (!command.result.empty())
      entry.figures = read_figures((folder / command.result).string(), command.unrepeatable);
    return entry;
  } catch (const std::exception&) {  // unreadable is not done
    return {};
  }
}

std::optional<LedgerEntry> ItemStore::ended(std::size_t i, const std::string& identity,
                                            bool fresh) {
  if (!fresh)
    if (auto known = last(i); known && known->identity == sha256_of(identity)) return known;
  auto entry = read_folder(i, identity);
  if (entry && read_only_) found_[i] = *entry;
  if (entry && !read_only_) ledger_.append(m_.items[i].name, *entry);
  return entry;
}

void ItemStore::fill(std::size_t i, const fs::path& part) const {
  for (const BatchFill& fill : m_.items[i].fills)
    write_file((part / fill.file).string(), filled_text(m_, m_.items[i], m_.texts[fill.text]));
}

ItemRow ItemStore::row(std::size_t i, const LedgerEntry& entry) const {
  const BatchItem& item = m_.items[i];
  ItemRow row{item.name, m_.commands[item.command].name,
              entry.failed           ? "failed"
              : entry.reason.empty() ? "done"
                                     : "done with warning",
              entry.reason, entry.figures};
  row.folder = item.folder;
  row.step = item.step;
  for (std::size_t k = 0; k < item.values.size(); ++k)
    if (!item.values[k].empty()) row.swept.emplace_back(m_.factors[k].name, item.values[k]);
  return row;
}

void ItemStore::note(std::size_t i, LedgerEntry entry) {
  entry.files = files_now(folder_of(i));
  entry.node = host_name();
  ledger_.append(m_.items[i].name, entry);
}

ItemRow ItemStore::put(std::size_t i, const fs::path& part, const std::string& identity,
                       const ItemEnd& end, bool all) {
  std::string reason = end.reason;
  try {
    if (reason.empty()) {
      ItemRow row;
      write_done(i, part, identity, end, all, row);
      return row;
    }
  } catch (const std::exception& e) {
    // Paths inside the work folder would name a folder that is gone.
    const std::string text = e.what(), prefix = part.string() + "/";
    reason = text.rfind(prefix, 0) == 0 ? text.substr(prefix.size()) : text;
  }
  try {
    write_failed(i, part, identity, reason, end);
  } catch (const std::exception&) {
    // The row has what went wrong first.
  }
  LedgerEntry entry;
  entry.failed = true;
  entry.reason = reason;
  return row(i, entry);
}

void ItemStore::write_done(std::size_t i, const fs::path& part, const std::string& identity,
                           const ItemEnd& end, bool all, ItemRow& row) {
  const BatchItem& item = m_.items[i];
  const BatchCommand& command = m_.commands[item.command];
  std::error_code error;
  for (const std::string& file : item.made)
    if (!fs::exists(part / file, error)) throw Error("wrote no " + file);
  LedgerEntry entry;
  entry.identity = sha256_of(identity);
  entry.seconds = end.seconds;
  entry.memory = end.memory;
  entry.reason = warnings_of(part / "log.txt");
  if (!command.result.empty())
    entry.figures = read_figures((part / command.result).string(), command.unrepeatable);
  Json record = {{"schema", kSchema}, {"schema_version", 1}, {"status", "done"}};
  record.update(Json::parse(identity));
  record["build"] = build_;
  record["outputs"] = Json::object();
  Json dropped = Json::object();
  const Json outputs = outputs_of(part);
  for (const auto& [name, hash] : outputs.items()) {
    entry.outputs.emplace_back(name, hash.get<std::string>());
    if (all || keeps(item.keep, name)) {
      record["outputs"][name] = hash;
    } else {
      dropped[name] = hash;
      fs::remove(part / name);
    }
  }
  if (!dropped.empty()) record["dropped"] = dropped;
  record["seconds"] = end.seconds;
  write_file((part / "item.json").string(), json_text(record));
  replace(i, part);
  row = this->row(i, entry);
  note(i, std::move(entry));
}

void ItemStore::write_failed(std::size_t i, const fs::path& part, const std::string& identity,
                             const std::string& reason, const ItemEnd& end) {
  for (const auto& entry : fs::directory_iterator(part))
    if (entry.path().filename() != "log.txt") fs::remove_all(entry.path());
  Json record = {
      {"schema", kSchema}, {"schema_version", 1}, {"status", "failed"}, {"reason", reason}};
  record.update(Json::parse(identity));
  record["build"] = build_;
  record["seconds"] = end.seconds;
  write_file((part / "item.json").string(), json_text(record));
  replace(i, part);
  LedgerEntry entry;
  entry.identity = sha256_of(identity);
  entry.failed = true;
  entry.reason = reason;
  entry.seconds = end.seconds;
  entry.memory = end.memory;
  note(i, std::move(entry));
}

void ItemStore::drop(std::size_t i) {
  const fs::path folder = folder_of(i);
  auto entry = last(i, true);
  Json record = item_record(folder);
  if (!entry || record.is_null()) return;
  bool any = false;
  for (const auto& [name, hash] : entry->outputs) {
    if (keeps(m_.items[i].keep, name) || !record["outputs"].contains(name)) continue;
    any = true;
    record["dropped"][name] = hash;
    record["outputs"].erase(name);
  }
  if (!any) return;
  // A kill in between: the item runs again.
  for (const auto& [name, hash] : record["dropped"].items()) fs::remove(folder / name);
  const Part whole(dir_, ".json", folder.string(), false);
  write_file(whole.path(), json_text(record));
  fs::rename(whole.path(), folder / "item.json");
  note(i, std::move(*entry));
}

// What stood there is removed with the part.
void ItemStore::replace(std::size_t i, const fs::path& part) const {
  const fs::path folder = folder_of(i);
  if (const std::string why = not_replaceable(folder); !why.empty())
    throw Error(folder.string() + ": " + why + ", so it is not replaced");
  std::error_code made;
  if (m_.items[i].folder != m_.items[i].name) fs::create_directories(folder.parent_path(), made);
  int error = rename_to_new(part, folder);
  if (error == EEXIST || error == ENOTEMPTY) error = exchange(part, folder);
  if (error)
    throw Error(folder.string() + ": cannot be written: " + std::generic_category().message(error));
}

void ItemStore::check_folders(bool all) {
  std::error_code error;
  std::set<fs::path> read;  // sorted, so that what lies in a folder follows its name
  std::set<std::string> paths;
  for (const BatchItem& item : m_.items)
    for (const BatchInput& input : item.inputs)
      if (!input.item && paths.insert(input.path).second)
        read.insert(fs::weakly_canonical(input.path, error));
  for (std::size_t i = 0; i < m_.items.size(); ++i) {
    const fs::path folder = folder_of(i);
    if (!fs::exists(fs::symlink_status(folder, error))) continue;
    const auto refuse = [&](const std::string& why) {
      throw InputError(folder.string(), "", why + ", so it is not replaced", "give another folder");
    };
    if (all || !ledger_.knows(m_.items[i].name))
      if (const std::string why = not_replaceable(folder); !why.empty()) refuse(why);
    const fs::path whole = fs::canonical(folder, error);
    if (const auto after = read.lower_bound(whole); after != read.end() && lies_in(*after, whole))
      for (const BatchItem& item : m_.items)
        for (const BatchInput& input : item.inputs)
          if (!input.item && lies_in(fs::weakly_canonical(input.path, error), whole))
            refuse("holds '" + input.shown + "', which is read");
  }
}

}  // namespace toothprep
