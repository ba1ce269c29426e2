#include "toothprep/tools/batch/summary.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <vector>

#include "toothprep/step/core/number_text.h"
#include "toothprep/step/core/statistics.h"
#include "toothprep/tools/io/plain_text.h"

namespace toothprep {
namespace {

constexpr std::size_t kMostLevels = 12, kParts = 6;

// The rows of one step, by columns.
struct StepTable {
  std::vector<std::string> factors, figures;                        // names, as first seen
  std::vector<std::vector<std::string>> levels;                     // by factor, by row
  std::vector<std::vector<std::pair<std::size_t, double>>> values;  // by figure: row, value
  std::size_t rows = 0;
};

template <class Value>
std::size_t column(const std::string& name, std::vector<std::string>& names,
                   std::vector<std::vector<Value>>& columns,
                   std::map<std::string, std::size_t>& place) {
  const auto [at, fresh] = place.try_emplace(name, names.size());
  if (fresh) {
    names.push_back(name);
    columns.emplace_back();
  }
  return at->second;
}

std::vector<std::pair<std::string, StepTable>> step_tables(const ItemRows& rows) {
  struct Places {
    std::map<std::string, std::size_t> factors, figures;
  };
  std::vector<std::pair<std::string, StepTable>> steps;
  std::vector<Places> places;
  for (const ItemRow& row : rows) {
    if (row.step.empty() || row.failed()) continue;
    std::size_t s = 0;
    while (s < steps.size() && steps[s].first != row.step) ++s;
    if (s == steps.size()) {
      steps.push_back({row.step, {}});
      places.emplace_back();
    }
    StepTable& t = steps[s].second;
    for (const auto& [name, value] : row.swept) {
      auto& levels = t.levels;
      const std::size_t k = column(name, t.factors, levels, places[s].factors);
      levels[k].resize(t.rows);
      levels[k].push_back(value);
    }
    for (const auto& [key, text] : row.figures)
      if (const auto value = decimal_number(text))
        t.values[column(key, t.figures, t.values, places[s].figures)].emplace_back(t.rows, *value);
      else if (text == "true" || text == "false")
        t.values[column(key, t.figures, t.values, places[s].figures)].emplace_back(
            t.rows, text == "true" ? 1 : 0);
    ++t.rows;
  }
  return steps;
}

// The level of each row, and the levels' names in order.
struct Levels {
  std::vector<std::string> names;
  std::vector<std::size_t> of;
};

Levels levels_of(const std::vector<std::string>& values) {
  std::vector<std::string> distinct = values;
  const auto less = [](const std::string& a, const std::string& b) {
    const auto x = decimal_number(a), y = decimal_number(b);
    return x && y ? *x < *y : x || y ? static_cast<bool>(x) : a < b;
  };
  std::sort(distinct.begin(), distinct.end(), less);
  distinct.erase(std::unique(distinct.begin(), distinct.end()), distinct.end());
  const bool numbers = std::all_of(distinct.begin(), distinct.end(), [](const std::string& v) {
    return decimal_number(v).has_value();
  });
  Levels levels;
  const bool parts = numbers && distinct.size() > kMostLevels;
  const std::size_t per_part = parts ? (distinct.size() + kParts - 1) / kParts : 1;
  for (std::size_t i = 0; i < distinct.size(); i += per_part) {
    const std::size_t last = std::min(i + per_part, distinct.size()) - 1;
    levels.names.push_back(parts ? distinct[i] + " to " + distinct[last] : distinct[i]);
  }
  for (const std::string& value : values)
    levels.of.push_back(
        static_cast<std::size_t>(std::lower_bound(distinct.begin(), distinct.end(), value, less) -
                                 distinct.begin()) /
        per_part);
  return levels;
}

double mean_of(const std::vector<double>& values) {
  double sum = 0;
  for (const double v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

double squares_about(const std::vector<double>& values, double mean) {
  double sum = 0;
  for (const double v : values) sum += (v - mean) * (v - mean);
  return sum;
}

// Count, mean, sd, ends and quantiles.
std::string figures_text(std::vector<double> values) {
  const double mean = mean_of(values);
  const auto n = static_cast<double>(values.size());
  std::string text = std::to_string(values.size()) + "," + shortest_text(mean) + ",";
  if (values.size() > 1) text += shortest_text(std::sqrt(squares_about(values, mean) / (n - 1)));
  std::sort(values.begin(), values.end());
  for (const double share : {0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0}) {
    const double rank = std::clamp(std::ceil(share * n), 1.0, n) - 1;
    text += "," + shortest_text(values[static_cast<std::size_t>(rank)]);
  }
  return text;
}

void add_factor(const std::string& before, const std::string& factor,
                const std::vector<std::string>& of_rows,
                const std::vector<std::pair<std::size_t, double>>& column, double total,
                double mean, std::string& csv) {
  std::vector<std::string> values;
  for (const auto& [row, value] : column)
    values.push_back(row < of_rows.size() ? of_rows[row] : std::string());
  const Levels levels = levels_of(values);
  if (levels.names.size() < 2) return;
  std::vector<std::vector<double>> groups(levels.names.size());
  for (std::size_t i = 0; i < column.size(); ++i) groups[levels.of[i]].push_back(column[i].second);
  double between = 0, least = INFINITY, most = -INFINITY;
  for (const auto& group : groups) {
    const double own = mean_of(group);
    between += static_cast<double>(group.size()) * (own - mean) * (own - mean);
    least = std::min(least, own);
    most = std::max(most, own);
  }
  for (std::size_t l = 0; l < groups.size(); ++l)
    csv += before + csv_cell(factor) + "," +
           (decimal_number(levels.names[l]) ? levels.names[l] : csv_cell(levels.names[l])) + "," +
           figures_text(groups[l]) + "," + shortest_text(between / total) + "," +
           shortest_text(most - least) + "\n";
}

}  // namespace

std::string summary_csv(const ItemRows& rows) {
  std::string csv =
      "step,figure,factor,level,count,mean,sd,min,q05,q25,median,q75,q95,max,variance_share,"
      "main_effect\n";
  for (const auto& [step, table] : step_tables(rows))
    for (std::size_t f = 0; f < table.figures.size(); ++f) {
      const std::string before = step + "," + csv_cell(table.figures[f]) + ",";
      std::vector<double> values;
      for (const auto& [row, value] : table.values[f]) values.push_back(value);
      csv += before + ",all," + figures_text(values) + ",,\n";
      const double mean = mean_of(values), total = squares_about(values, mean);
      if (!(total > 0)) continue;
      for (std::size_t k = 0; k < table.factors.size(); ++k)
        add_factor(before, table.factors[k], table.levels[k], table.values[f], total, mean, csv);
    }
  return csv;
}

}  // namespace toothprep
