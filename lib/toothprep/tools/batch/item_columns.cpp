#include "toothprep/tools/batch/item_columns.h"

#include <algorithm>
#include <set>

namespace toothprep {

ItemColumns::ItemColumns(const ItemRows& rows) {
  const std::vector<std::string> leading = {"points_percent", "passed"};
  std::vector<std::string> factors, figures;
  std::set<std::string> seen;
  for (const ItemRow& row : rows) {
    steps_ = steps_ || !row.step.empty();
    for (const auto& [name, value] : row.swept)
      if (std::find(factors.begin(), factors.end(), name) == factors.end()) factors.push_back(name);
    for (const auto& [key, value] : row.figures)
      if (seen.insert(key).second &&
          std::find(leading.begin(), leading.end(), key) == leading.end())
        figures.push_back(key);
  }
  names_ = {"name", "status"};
  const auto add_figure = [&](const std::string& key) {
    figures_[key] = names_.size();
    names_.push_back(key);
  };
  for (const std::string& key : leading)
    if (seen.count(key) > 0) add_figure(key);
  leading_ = names_.size() - 2;
  names_.insert(names_.end(), {"command", "reason"});
  if (steps_) names_.emplace_back("step");
  factors_at_ = names_.size();
  for (const std::string& factor : factors) {
    factors_[factor] = names_.size();
    names_.push_back("sweep." + factor);
  }
  figures_at_ = names_.size();
  for (const std::string& key : figures) add_figure(key);
}

std::vector<std::string> ItemColumns::cells(const ItemRow& row) const {
  std::vector<std::string> cells(names_.size());
  cells[0] = row.name;
  cells[1] = row.status;
  cells[2 + leading_] = row.command;
  cells[3 + leading_] = row.reason;
  if (steps_) cells[4 + leading_] = row.step;
  for (const auto& [name, value] : row.swept) cells[factors_.at(name)] = value;
  for (const auto& [key, value] : row.figures)
    if (const auto at = figures_.find(key); at != figures_.end()) cells[at->second] = value;
  return cells;
}

}  // namespace toothprep
