// "Did you mean ...?": the known name that is nearest to a mistyped one.
#pragma once

#include <algorithm>
#include <numeric>
#include <string>
#include <string_view>
#include <vector>

namespace toothprep {

// Levenshtein distance: insertions, deletions and substitutions that turn `a` into `b`.
inline std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i + 1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t substituted = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({substituted, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

// The candidate nearest to `name`, the first of equals; empty if there are no candidates. Two
// mistakes are more frequent than a mistyped letter and count for less: a key without its unit
// ("stiffness" for "stiffness_n_per_mm") and one in the wrong table (for
// "coupling.stiffness_n_per_mm").
inline std::string nearest_name(std::string_view name, const std::vector<std::string>& candidates) {
  constexpr std::size_t kLongest = 100;  // of a name: bounds the work on garbage
  name = name.substr(0, kLongest);
  std::string nearest;
  std::size_t least = std::string::npos;
  for (const std::string& candidate : candidates) {
    const std::size_t dot = candidate.rfind('.');
    const std::string_view last = std::string_view(candidate).substr(dot + 1);  // npos + 1 = 0
    const bool lacks_unit = last.substr(0, name.size()) == name &&
                            last.substr(std::min(name.size(), last.size()), 1) == "_";
    const std::size_t distance =
        lacks_unit ? 0
                   : std::min({edit_distance(name, candidate), edit_distance(name, last),
                               2 + edit_distance(name, last.substr(0, name.size()))});
    if (distance < least) {
      least = distance;
      nearest = candidate;
    }
  }
  return nearest;
}

}  // namespace toothprep
