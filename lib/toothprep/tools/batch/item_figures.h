// The figures of one item, and the table of all of them.
#pragma once

#include <functional>
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
  std::string folder = {};  // below DIR; empty: the name
  std::string step = {};    // of a sweep, as is what follows: factors and their values
  std::vector<std::pair<std::string, std::string>> swept = {};

  [[nodiscard]] bool failed() const { return status == "failed"; }
  // The figure as it stands there; empty if it is none of the item's.
  [[nodiscard]] std::string figure(const std::string& key) const;
};

// Rows one at a time, so that not all have to be in memory.
class ItemRows {
 public:
  ItemRows() = default;
  ItemRows(std::vector<ItemRow> rows);  // NOLINT: a list of rows is one
  ItemRows(std::size_t count, std::function<ItemRow(std::size_t)> row)
      : count_(count), row_(std::move(row)) {}
  [[nodiscard]] std::size_t size() const { return count_; }
  ItemRow operator[](std::size_t i) const { return row_(i); }

  class Iterator {
   public:
    Iterator(const ItemRows& rows, std::size_t at) : rows_(&rows), at_(at) {}
    ItemRow operator*() const { return (*rows_)[at_]; }
    Iterator& operator++() {
      ++at_;
      return *this;
    }
    bool operator!=(const Iterator& other) const { return at_ != other.at_; }

   private:
    const ItemRows* rows_;
    std::size_t at_;
  };
  [[nodiscard]] Iterator begin() const { return {*this, 0}; }
  [[nodiscard]] Iterator end() const { return {*this, count_}; }

 private:
  std::size_t count_ = 0;
  std::function<ItemRow(std::size_t)> row_;
};

// Rows in their order; columns name, status, of scores points_percent and passed, then command,
// reason, of a sweep step and sweep.FACTOR for each factor, and the other figures' keys as they are
// first seen. Quoted as RFC 4180 has it.
std::string table_csv(const ItemRows& rows);
std::string table_json(const ItemRows& rows, const std::string& version, const std::string& build);
// To files, a row at a time. Throw Error.
void write_table_csv(const ItemRows& rows, const std::string& path);
void write_table_json(const ItemRows& rows, const std::string& version, const std::string& build,
                      const std::string& path);

}  // namespace toothprep
