// Order statistics: values that occur, never means of neighbours.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace toothprep {

// The value at `rank` (from 0) of the sorted values, which must be more than `rank`.
template <class Value>
Value value_at_rank(std::vector<Value> values, std::size_t rank) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// The smallest value that at least `share` of the values, of which there is one or more, do not
// exceed.
template <class Value>
Value quantile(std::vector<Value> values, double share) {
  const auto n = static_cast<double>(values.size());
  const double rank = std::clamp(std::ceil(share * n), 1.0, n) - 1;
  return value_at_rank(std::move(values), static_cast<std::size_t>(rank));
}

// The value in the middle; of an even count, the upper one of the two. Not of an empty set.
template <class Value>
Value median(std::vector<Value> values) {
  const std::size_t middle = values.size() / 2;
  return value_at_rank(std::move(values), middle);
}

// Of normally distributed values: the standard deviation by the median size.
constexpr double kSigmaOfMedian = 1.4826;

struct WeightedValue {
  double value = 0, weight = 0;
};

// The smallest value that values of at least `share` of all the weight do not exceed. Not of an
// empty set.
inline double weighted_quantile(std::vector<WeightedValue> values, double share) {
  std::sort(values.begin(), values.end(), [](const WeightedValue& a, const WeightedValue& b) {
    return std::pair(a.value, a.weight) < std::pair(b.value, b.weight);
  });
  double total = 0, below = 0;
  for (const WeightedValue& v : values) total += v.weight;
  const double wanted = share * total * (1 - 1e-12);  // the sums' own rounding
  for (const WeightedValue& v : values)
    if ((below += v.weight) >= wanted) return v.value;
  return values.back().value;
}

}  // namespace toothprep
