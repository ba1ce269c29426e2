// TOML read strictly: every key is read by name and type, and a key that nothing read is an
// error that names the nearest known key. For the .cpp files of readers (it includes toml++).
#pragma once

#include <toml++/toml.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <optional>
#include <string>
#include <vector>

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/geometry.h"
#include "toothprep/step/core/nearest_name.h"
#include "toothprep/step/core/regular_file.h"

namespace toothprep {

// The whole text of a file that a person wrote; refuses what is no regular file and more than 16 MB.
inline std::string read_small_text(const std::string& path) {
  constexpr std::uint64_t kLargest = 16 << 20;
  const std::uint64_t size = regular_file_size(path);
  if (size > kLargest)
    throw InputError(path, "", "is larger than 16 MB", "this is not a file of settings");
  std::ifstream in(path, std::ios::binary);
  std::string text(static_cast<std::size_t>(size), '\0');
  in.read(text.data(), static_cast<std::streamsize>(size));
  if (!in && !in.eof()) throw InputError(path, "", "cannot be read");
  text.resize(static_cast<std::size_t>(in.gcount()));
  return text;
}

// Throws InputError with line and column for what is not TOML.
inline toml::table parse_toml(const std::string& text, const std::string& where) {
  try {
    return toml::parse(text, where);
  } catch (const toml::parse_error& e) {
    throw InputError(where,
                     "line " + std::to_string(e.source().begin.line) + ", column " +
                         std::to_string(e.source().begin.column),
                     std::string(e.description()), "correct the TOML");
  }
}

// A table that is being read. Each read names a key and its type; done() then refuses the keys that
// were never named. The toml::table must outlive it.
class StrictTable {
 public:
  StrictTable(const toml::table& table, std::string where, std::string path = {})
      : table_(table), where_(std::move(where)), path_(std::move(path)) {}

  bool has(const std::string& key) const { return table_.contains(key); }
  std::string path_of(const std::string& key) const {
    return path_.empty() ? key : path_ + "." + key;
  }
  const std::string& where() const { return where_; }

  [[noreturn]] void refuse(const std::string& key, const std::string& condition,
                           const std::string& remedy = {}) const {
    throw InputError(where_, path_of(key), condition, remedy);
  }
  // For a key that was not given but must be.
  [[noreturn]] void missing(const std::string& key, const std::string& example) const {
    throw InputError(where_, path_of(key), "is missing", "add " + key + " = " + example);
  }

  // Integers count as numbers. NaN and infinity pass: the caller knows what it may be.
  std::optional<double> number(const std::string& key) {
    const toml::node* node = find(key);
    if (!node) return {};
    if (const auto value = number_of(*node)) return value;
    refuse(key, "must be a number, not " + kind_of(*node));
  }
  std::optional<std::int64_t> integer(const std::string& key) {
    const toml::node* node = find(key);
    if (!node) return {};
    if (const auto* value = node->as_integer()) return value->get();
    refuse(key, "must be a whole number, not " + kind_of(*node));
  }
  std::optional<bool> boolean(const std::string& key) {
    const toml::node* node = find(key);
    if (!node) return {};
    if (const auto* value = node->as_boolean()) return value->get();
    refuse(key, "must be true or false, not " + kind_of(*node));
  }
  std::optional<std::string> text(const std::string& key) {
    const toml::node* node = find(key);
    if (!node) return {};
    if (const auto* value = node->as_string()) return value->get();
    refuse(key, "must be a text in quotes, not " + kind_of(*node));
  }
  // One of `choices`; another text is refused with the nearest of them.
  std::optional<std::string> choice(const std::string& key,
                                    const std::vector<std::string>& choices) {
    std::optional<std::string> value = text(key);
    if (value && std::find(choices.begin(), choices.end(), *value) == choices.end()) {
      std::string list;
      for (const std::string& c : choices) list += (list.empty() ? "" : ", ") + ("\"" + c + "\"");
      refuse(key, "\"" + value->substr(0, 60) + "\" is not known (known: " + list + ")",
             "did you mean \"" + nearest_name(*value, choices) + "\"?");
    }
    return value;
  }
  // Three finite numbers.
  std::optional<Vec3> vector(const std::string& key) {
    const toml::node* node = find(key);
    if (!node) return {};
    return vector_of(*node, key);
  }
  // Finite numbers, any count.
  std::optional<std::vector<double>> numbers(const std::string& key) {
    const toml::node* node = find(key);
    if (!node) return {};
    const toml::array* array = node->as_array();
    if (!array) refuse(key, "must be a list of numbers, not " + kind_of(*node));
    std::vector<double> values;
    values.reserve(array->size());
    for (const toml::node& entry : *array) {
      const std::optional<double> value = number_of(entry);
      if (!value) refuse(key, "must be a list of numbers, found " + kind_of(entry));
      if (!std::isfinite(*value)) refuse(key, "must be finite");
      values.push_back(*value);
    }
    return values;
  }
  // Two numbers [low, high], low <= high; either may be infinite (an open end).
  std::optional<std::array<double, 2>> range(const std::string& key) {
    const toml::node* node = find(key);
    if (!node) return {};
    const toml::array* array = node->as_array();
    if (!array || array->size() != 2)
      refuse(key, "must be two numbers [low, high], not " +
                      (array ? "a list of " + std::to_string(array->size()) : kind_of(*node)));
    std::array<double, 2> ends{};
    for (std::size_t i = 0; i < 2; ++i) {
      const std::optional<double> value = number_of(*array->get(i));
      if (!value) refuse(key, "must be two numbers [low, high], found " + kind_of(*array->get(i)));
      ends[i] = *value;
    }
    if (!(ends[0] <= ends[1])) refuse(key, "must be [low, high] with low not above high");
    return ends;
  }
  // Whether the key is there with a list for its value (where a key takes a list or something
  // else).
  bool is_list(const std::string& key) const {
    const toml::node* node = table_.get(key);
    return node && node->is_array();
  }
  std::optional<std::vector<Vec3>> vectors(const std::string& key) {
    const toml::node* node = find(key);
    if (!node) return {};
    const toml::array* array = node->as_array();
    if (!array) refuse(key, "must be a list of points [x, y, z], not " + kind_of(*node));
    std::vector<Vec3> points;
    points.reserve(array->size());
    for (const toml::node& point : *array)
      points.push_back(vector_of(point, key + "[" + std::to_string(points.size()) + "]"));
    return points;
  }
  // A text, or a list of texts.
  std::optional<std::vector<std::string>> texts(const std::string& key) {
    const toml::node* node = find(key);
    if (!node) return {};
    if (const auto* value = node->as_string()) return std::vector<std::string>{value->get()};
    const toml::array* array = node->as_array();
    if (!array) refuse(key, "must be a list of texts in quotes, not " + kind_of(*node));
    std::vector<std::string> values;
    for (const toml::node& entry : *array) {
      const auto* value = entry.as_string();
      if (!value) refuse(key, "must be a list of texts in quotes, found " + kind_of(entry));
      values.push_back(value->get());
    }
    return values;
  }
  std::optional<StrictTable> table(const std::string& key) {
    const toml::node* node = find(key);
    if (!node) return {};
    if (const auto* value = node->as_table()) return StrictTable(*value, where_, path_of(key));
    refuse(key, "must be a table [" + path_of(key) + "], not " + kind_of(*node));
  }
  // [[key]] tables, in order, with paths key[0], key[1], ...
  std::optional<std::vector<StrictTable>> tables(const std::string& key) {
    const toml::node* node = find(key);
    if (!node) return {};
    const toml::array* array = node->as_array();
    if (!array) refuse(key, "must be tables [[" + path_of(key) + "]], not " + kind_of(*node));
    std::vector<StrictTable> result;
    for (const toml::node& entry : *array) {
      const std::string path = path_of(key) + "[" + std::to_string(result.size()) + "]";
      if (!entry.as_table())
        throw InputError(where_, path, "must be a table [[" + path_of(key) + "]]");
      result.emplace_back(*entry.as_table(), where_, path);
    }
    return result;
  }

  // Refuses every key that was not read. `elsewhere`: dotted keys of other tables that may
  // have been meant.
  void done(const std::vector<std::string>& elsewhere = {}) const {
    for (const auto& [key, node] : table_) {
      const std::string name(key.str());
      if (std::find(known_.begin(), known_.end(), name) != known_.end()) continue;
      std::vector<std::string> candidates = known_;
      candidates.insert(candidates.end(), elsewhere.begin(), elsewhere.end());
      throw InputError(where_, path_of(name.substr(0, 60)),
                       "unknown key on line " + std::to_string(node.source().begin.line),
                       "did you mean '" + nearest_name(name, candidates) + "'?");
    }
  }

 private:
  const toml::node* find(const std::string& key) {
    if (std::find(known_.begin(), known_.end(), key) == known_.end()) known_.push_back(key);
    return table_.get(key);
  }
  static std::optional<double> number_of(const toml::node& node) {
    if (const auto* value = node.as_floating_point()) return value->get();
    if (const auto* value = node.as_integer()) return static_cast<double>(value->get());
    return {};
  }
  Vec3 vector_of(const toml::node& node, const std::string& key) const {
    const toml::array* array = node.as_array();
    if (!array || array->size() != 3)
      refuse(key, "must be three numbers [x, y, z], not " +
                      (array ? "a list of " + std::to_string(array->size()) : kind_of(node)));
    Vec3 v;
    for (int i = 0; i < 3; ++i) {
      const toml::node& entry = *array->get(static_cast<std::size_t>(i));
      const std::optional<double> value = number_of(entry);
      if (!value) refuse(key, "must be three numbers [x, y, z], found " + kind_of(entry));
      v[i] = *value;
    }
    if (!v.allFinite()) refuse(key, "must be finite");
    return v;
  }
  static std::string kind_of(const toml::node& node) {
    if (node.is_string()) return "a text";
    if (node.is_integer() || node.is_floating_point()) return "a number";
    if (node.is_boolean()) return "true or false";
    if (node.is_array()) return "a list";
    if (node.is_table()) return "a table";
    return "a date or time";
  }

  const toml::table& table_;
  std::string where_, path_;
  std::vector<std::string> known_;
};

}  // namespace toothprep
