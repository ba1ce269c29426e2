// The columns of a batch's tables.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "toothprep/tools/batch/item_figures.h"

namespace toothprep {

// Found in one pass over the rows: name, status, of scores points_percent and passed, then command,
// reason, of a sweep step and sweep.FACTOR for each factor, and the other figures' keys as they are
// first seen.
class ItemColumns {
 public:
  explicit ItemColumns(const ItemRows& rows);

  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  // A text per column as the item has it; empty where it has none.
  [[nodiscard]] std::vector<std::string> cells(const ItemRow& row) const;
  // Whether the column holds texts in every table (name, status, command, reason, step).
  [[nodiscard]] bool is_text(std::size_t column) const {
    return column < 2 || (column >= 2 + leading_ && column < factors_at_);
  }
  // Of a sweep: numbers or texts.
  [[nodiscard]] bool is_factor(std::size_t column) const {
    return column >= factors_at_ && column < figures_at_;
  }

 private:
  std::vector<std::string> names_;
  std::size_t leading_ = 0, factors_at_ = 0, figures_at_ = 0;
  bool steps_ = false;
  std::map<std::string, std::size_t> factors_, figures_;  // column, by name
};

}  // namespace toothprep
